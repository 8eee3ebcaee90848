"""The similarity that lays points on others: scale, rotation, translation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Similarity:
    """target = scale * rotation @ source + translation."""

    scale: float
    rotation: np.ndarray  # (3, 3)
    translation: np.ndarray  # (3,)

    def apply(self, points: np.ndarray) -> np.ndarray:
        """Points (m, 3) of the source frame in the target's."""
        return self.scale * points @ self.rotation.T + self.translation

    def inverse(self) -> Similarity:
        """From the target's frame to the source's."""
        rotation = self.rotation.T
        return Similarity(1.0 / self.scale, rotation, -(rotation @ self.translation) / self.scale)


def procrustes(source: np.ndarray, target: np.ndarray, rigid: bool = False) -> Similarity:
    """The least-squares similarity from points (m, 3) to points (m, 3), row for row, m >= 3.

    ``rigid``: of scale 1. Umeyama (1991), eqs. 38-42; libraries keep the rotation alone, or one
    that may be a reflection.
    """
    middle_s, middle_t = source.mean(axis=0), target.mean(axis=0)
    a, b = source - middle_s, target - middle_t
    u, singular, vt = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = (u * sign) @ vt
    scale = 1.0 if rigid else float(singular @ sign / max(float((a**2).sum()), 1e-300))
    return Similarity(scale, rotation, middle_t - scale * rotation @ middle_s)
