"""Whether photos are of one person: identities drawn as the statistics say, and one that is not;
skins that agree with the landmarks, and that do not."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.trust.same_person import (
    SURPRISE,
    Evidence,
    Likeness,
    combined,
    difference,
    odd_ones,
)

MODES, FREEDOM = 12, 130


def evidence(
    identity: np.ndarray, seed: int, strength: float = 30.0, scale: float = 1.0
) -> Evidence:
    """What landmarks of so much information, ``scale`` times noisier than they say, would tell of
    ``identity``.
    """
    random = np.random.default_rng(seed)
    basis = np.linalg.qr(random.normal(size=(MODES, MODES)))[0]
    information = basis @ np.diag(strength * 10.0 ** random.uniform(-2, 1, MODES)) @ basis.T
    seen = identity + np.sqrt(scale) * np.linalg.cholesky(
        np.linalg.inv(information)
    ) @ random.normal(size=MODES)
    found = np.linalg.solve(information + np.eye(MODES), information @ seen)
    return Evidence(found, information, np.eye(MODES), scale * FREEDOM, FREEDOM)


def person(seed: int) -> np.ndarray:
    return np.random.default_rng(1000 + seed).normal(size=MODES)


@pytest.mark.parametrize("scale", [1.0, 6.0])
def test_photos_of_one_person_go_together(scale: float):
    found = [
        len(odd_ones([evidence(person(seed), 7 * seed + photo, scale=scale) for photo in range(3)]))
        for seed in range(100)
    ]
    print(f"{np.count_nonzero(found)} of 100 persons had an odd photo")
    # Three looks at each: 3 expected at most.
    assert np.count_nonzero(found) <= 6


def test_the_photo_of_another_is_found():
    for seed in range(20):
        photos = [evidence(person(seed), 7 * seed + photo) for photo in range(3)]
        photos.insert(1, evidence(person(seed + 500), seed))
        assert next(iter(odd_ones(photos))) == 1, "the oddest"


def test_of_two_neither_is_known_to_be_wrong():
    assert sorted(odd_ones([evidence(person(1), 1), evidence(person(2), 2)])) == [0, 1]


def test_what_says_nothing_is_no_doubt():
    silent = evidence(person(1), 1, strength=1e-4)
    found = difference(silent, [evidence(person(2), 2)])
    assert abs(found.nats) < 0.1 and not found.doubtful


def test_all_photos_together_are_what_one_with_all_landmarks_would_be():
    photos = [evidence(person(3), seed) for seed in range(3)]
    identity, covariance = combined(photos)
    information = sum(photo.information for photo in photos)
    seen = [np.linalg.solve(photo.information, photo.pull) for photo in photos]
    wanted = sum(photo.information @ one for photo, one in zip(photos, seen, strict=True))
    np.testing.assert_allclose(
        (information + np.eye(MODES)) @ identity, wanted, rtol=1e-6, atol=1e-6
    )
    np.testing.assert_allclose(covariance @ (information + np.eye(MODES)), np.eye(MODES), atol=1e-9)
    error = [
        np.linalg.norm(one - person(3)) for one in (identity, *(photo.identity for photo in photos))
    ]
    assert error[0] < min(error[1:])


def careless(person_seed: int, seed: int, shift: float = 3.0) -> Evidence:
    """Landmarks whose errors look like another face."""
    random = np.random.default_rng(seed)
    return evidence(person(person_seed) + shift * random.normal(size=MODES), seed)


ALIKE, OTHER, UNTOLD = Likeness(500, 0.7), Likeness(500, 0.15), Likeness(20, 0.9)


def test_one_skin_is_one_person_whatever_the_landmarks_say():
    photos = [careless(1, 1), careless(1, 2)]
    assert len(odd_ones(photos)) == len(odd_ones(photos, {(0, 1): UNTOLD})) == 2
    assert odd_ones(photos, {(0, 1): ALIKE}) == {}


def test_other_skin_is_no_other_person_where_landmarks_agree():
    photos = [evidence(person(1), 1), evidence(person(1), 2)]
    assert odd_ones(photos, {(0, 1): OTHER}) == {}


def test_a_stranger_is_found_beside_skins_that_agree():
    photos = [careless(1, 1), careless(1, 2), careless(1, 3), evidence(person(501), 4)]
    skins = {(0, 1): ALIKE, (1, 2): ALIKE, (0, 3): OTHER, (1, 3): OTHER, (2, 3): OTHER}
    assert list(odd_ones(photos, skins)) == [3]


def test_the_bayes_factor_is_the_ratio_of_the_integrals():
    """One mode, integrated over a grid, with landmarks that see it directly."""
    x = np.linspace(-12, 12, 200001)
    step = x[1] - x[0]
    prior = np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi)

    def likelihood(seen: float, information: float) -> np.ndarray:
        return np.exp(-0.5 * information * (x - seen) ** 2)

    one, other = (0.8, 5.0), (-1.1, 2.0)
    photos = [
        Evidence(np.array([j * m / (1 + j)]), np.array([[j]]), np.eye(1)) for m, j in (one, other)
    ]
    together = (prior * likelihood(*one) * likelihood(*other)).sum() * step
    apart = [(prior * likelihood(*each)).sum() * step for each in (one, other)]
    wanted = np.log(together / apart[0] / apart[1])
    np.testing.assert_allclose(difference(photos[0], photos[1:]).nats, wanted, rtol=1e-6)


def test_what_landmarks_tell_is_the_mean_over_people():
    found = [
        difference(evidence(person(seed), 2 * seed), [evidence(person(seed), 2 * seed + 1)])
        for seed in range(300)
    ]
    nats, told = np.array([(one.nats, one.told) for one in found]).T
    np.testing.assert_allclose(nats.mean(), told.mean(), atol=4 * nats.std() / np.sqrt(len(nats)))
    assert told.mean() > SURPRISE
