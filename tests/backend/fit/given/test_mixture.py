"""Mixtures of Gaussians against known ones, SciPy's densities and weighted moments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from facestage.fit.given.mixture import Mixture

FLOOR = np.array([1e-6, 1e-6])
MEANS = np.array([[0.0, 0.0], [3.0, -1.0]])
COVARIANCES = np.array([[[1.0, 0.3], [0.3, 0.5]], [[0.2, -0.1], [-0.1, 0.3]]])


@pytest.fixture(scope="module")
def samples() -> np.ndarray:
    """A third of the second Gaussian."""
    random = np.random.default_rng(1)
    return np.concatenate(
        [
            random.multivariate_normal(mean, covariance, count)
            for mean, covariance, count in zip(MEANS, COVARIANCES, (4000, 2000), strict=True)
        ]
    )


def learnt(samples: np.ndarray, weight: np.ndarray, count: int, steps: int) -> Mixture:
    return Mixture.spread(samples, weight, count, FLOOR).stepped(samples, weight, steps)


def likelihood(mixture: Mixture, samples: np.ndarray, weight: np.ndarray) -> float:
    return float(weight @ mixture.log_density(samples) / weight.sum())


def test_the_gaussians_that_were_drawn_from_are_found(samples: np.ndarray):
    found = learnt(samples, np.ones(len(samples)), 2, 60)
    order = np.argsort(found.means[:, 0])
    np.testing.assert_allclose(found.shares[order], [2 / 3, 1 / 3], atol=0.02)
    np.testing.assert_allclose(found.means[order], MEANS, atol=0.06)
    np.testing.assert_allclose(found.covariances[order], COVARIANCES, atol=0.06)


def test_densities_are_those_of_scipy(samples: np.ndarray):
    mixture = replace(
        learnt(samples, np.ones(len(samples)), 2, 1),
        shares=np.array([0.3, 0.7]),
        means=MEANS,
        covariances=COVARIANCES,
    )
    slow = sum(
        share * multivariate_normal(mean, covariance).pdf(samples)
        for share, mean, covariance in zip(
            mixture.shares, mixture.means, mixture.covariances, strict=True
        )
    )
    np.testing.assert_allclose(
        mixture.log_density(samples) - np.log(2 * np.pi), np.log(slow), atol=1e-6
    )


def test_no_step_makes_the_samples_less_likely(samples: np.ndarray):
    weight = np.random.default_rng(2).random(len(samples))
    mixture = Mixture.spread(samples, weight, 3, FLOOR)
    before = likelihood(mixture, samples, weight)
    for _ in range(15):
        mixture = mixture.stepped(samples, weight)
        after = likelihood(mixture, samples, weight)
        assert after > before - 1e-5
        before = after
    assert before > likelihood(Mixture.spread(samples, weight, 3, FLOOR), samples, weight) + 0.1


def test_one_gaussian_has_the_weighted_moments_and_the_floor(samples: np.ndarray):
    weight = np.random.default_rng(3).random(len(samples))
    mixture = replace(Mixture.spread(samples, weight, 1, FLOOR), floor=np.array([0.5, 0.25]))
    found = mixture.stepped(samples, weight)
    np.testing.assert_allclose(found.means[0], np.average(samples, axis=0, weights=weight))
    covariance = np.cov(samples.T, aweights=weight, ddof=0) + np.diag([0.5, 0.25])
    np.testing.assert_allclose(found.covariances[0], covariance, atol=1e-9)


def test_a_sample_that_weighs_twice_counts_as_two(samples: np.ndarray):
    some = samples[::20]
    start = Mixture.spread(some, np.ones(len(some)), 2, FLOOR)
    weight = np.where(np.arange(len(some)) % 3 == 0, 2.0, 1.0)
    repeated = np.concatenate([some, some[::3]])
    one, two = start.stepped(some, weight, 5), start.stepped(repeated, np.ones(len(repeated)), 5)
    np.testing.assert_allclose(one.means, two.means, atol=1e-6)
    np.testing.assert_allclose(one.covariances, two.covariances, atol=1e-6)


def test_what_weighs_nothing_is_no_start_and_does_not_count(samples: np.ndarray):
    weight = np.where(samples[:, 0] < 1.5, 1.0, 0.0)
    found = learnt(samples, weight, 2, 20)
    assert found.means[:, 0].max() < 1.5
    moved = np.where(weight[:, None] > 0, samples, 1e3)
    np.testing.assert_allclose(learnt(moved, weight, 1, 3).means[0], samples[weight > 0].mean(0))


def test_the_same_samples_give_the_same_mixture(samples: np.ndarray):
    one, two = (learnt(samples, np.ones(len(samples)), 3, 3) for _ in range(2))
    np.testing.assert_array_equal(one.means, two.means)


def test_no_weight_at_all_gives_numbers(samples: np.ndarray):
    found = learnt(samples, np.zeros(len(samples)), 2, 2)
    assert np.isfinite(found.log_density(samples)).all()
