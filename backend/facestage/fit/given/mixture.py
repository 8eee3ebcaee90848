"""Mixtures of Gaussians fitted to weighted samples, by expectation-maximisation (Dempster et al.
1977).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Added to sums of weights, which would else be divided by when a component has no sample.
TINY = 1e-9


@dataclass(frozen=True)
class Mixture:
    """``shares`` (k,) of Gaussians of ``means`` (k, d) and ``covariances`` (k, d, d), to which
    ``floor`` (d,) variances were added: no component is narrower.
    """

    shares: np.ndarray
    means: np.ndarray
    covariances: np.ndarray
    floor: np.ndarray

    @classmethod
    def spread(
        cls, samples: np.ndarray, weight: np.ndarray, count: int, floor: np.ndarray
    ) -> Mixture:
        """A start: ``count`` means far from one another among ``samples`` (n, d) of ``weight``
        (n,), as k-means++ chooses them (Arthur and Vassilvitskii 2007), the same each time.
        """
        random = np.random.default_rng(0)
        deviation = samples.std(axis=0) + np.sqrt(floor)
        chance = weight + TINY
        chosen: list[int] = []
        for _ in range(count):
            chosen.append(int(random.choice(len(samples), p=chance / chance.sum())))
            away = (((samples[:, None] - samples[chosen]) / deviation) ** 2).sum(-1).min(1)
            chance = weight * away + TINY
        covariance = np.diag(deviation**2 / 2 + floor)
        shares = np.full(count, 1 / count)
        return cls(shares, samples[chosen], np.repeat(covariance[None], count, axis=0), floor)

    def log_parts(self, samples: np.ndarray) -> np.ndarray:
        """(k, n) the logarithm of each component's share of the density at ``samples`` (n, d), up
        to the constant (2 pi)^(-d/2) that all have.
        """
        roots = np.linalg.cholesky(self.covariances)
        result = np.empty((len(self.shares), len(samples)), samples.dtype)
        for index, (root, mean) in enumerate(zip(roots, self.means, strict=True)):
            white = (samples - mean.astype(samples.dtype)) @ np.linalg.inv(root).T.astype(
                samples.dtype
            )
            scale = np.log(self.shares[index] + TINY) - np.log(np.diag(root)).sum()
            result[index] = scale - 0.5 * np.einsum("ij,ij->i", white, white)
        return result

    def log_density(self, samples: np.ndarray) -> np.ndarray:
        """(n,) the logarithm of the density at ``samples`` (n, d), up to the same constant."""
        return np.asarray(np.logaddexp.reduce(self.log_parts(samples), axis=0))

    def stepped(self, samples: np.ndarray, weight: np.ndarray, steps: int = 1) -> Mixture:
        """After ``steps`` of expectation and maximisation: nearer to ``samples`` (n, d) of
        ``weight`` (n,).
        """
        mixture = self
        for _ in range(steps):
            parts = mixture.log_parts(samples)
            of_each = np.exp(parts - np.logaddexp.reduce(parts, axis=0)) * weight
            sums = of_each.sum(axis=1) + TINY
            means = of_each @ samples / sums[:, None]
            covariances = np.empty_like(mixture.covariances)
            for index, mean in enumerate(means):
                away = samples - mean
                covariances[index] = (away.T * of_each[index]) @ away / sums[index]
            covariances += np.diag(self.floor)
            mixture = Mixture(sums / sums.sum(), means, covariances, self.floor)
        return mixture
