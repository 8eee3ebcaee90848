"""Displacements known at some points of a face, spread smoothly over the rest."""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial.distance import cdist


def smooth_displacement(
    points: np.ndarray,
    displacement: np.ndarray,
    noise: np.ndarray,
    queries: np.ndarray,
    reach: float,
) -> np.ndarray:
    """(q, 3) displacement at queries (q, 3) from those (m, 3) at points (m, 3): the mean of a
    Gaussian process.

    noise (m,): standard deviation of each given displacement over that of the process; reach: the
    distance, in the points' unit, over which displacements resemble each other. Far from every
    point the displacement fades to 0.
    """
    if not len(points):
        return np.zeros((len(queries), 3))
    covariance = _kernel(points, points, reach)
    covariance[np.diag_indices(len(points))] += np.maximum(noise, 1e-3) ** 2
    weights = cho_solve(cho_factor(covariance), displacement)
    result = np.empty((len(queries), 3))
    for start in range(0, len(queries), 4096):
        part = slice(start, start + 4096)
        result[part] = _kernel(queries[part], points, reach) @ weights
    return result


def _kernel(a: np.ndarray, b: np.ndarray, reach: float) -> np.ndarray:
    return np.exp(-0.5 * cdist(a, b, "sqeuclidean") / reach**2)
