"""A smoother that writes the whole system down: slow, and obviously right."""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from facestage.fit.sequence.motion import Motion


def dense_system(
    hessian: np.ndarray, gradient: np.ndarray, motion: Motion, differences: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The Hessian (F d, F d) and gradient (F d,) of all frames with their second differences."""
    frames, size = gradient.shape
    total = np.zeros((frames, size, frames, size))
    for t in range(frames):
        total[t, :, t, :] = hessian[t]
    slope = gradient.copy()
    for k, triple in enumerate(motion.triples.frames):
        for i in range(size):
            row = np.zeros((frames, size))
            row[triple, i] = motion.triples.factors[k]
            precision = motion.weights[k, i] / motion.scales[i] ** 2
            total += precision * np.einsum("ai,bj->aibj", row, row)
            slope += precision * differences[k, i] * row
    return total.reshape(frames * size, -1), slope.ravel()


def bounded_minimum(
    matrix: np.ndarray, slope: np.ndarray, low: np.ndarray, high: np.ndarray
) -> np.ndarray:
    """The x of least 0.5 x^T A x + g^T x between the bounds."""
    scale = 1.0 / np.sqrt(np.diag(matrix))
    scaled, right = matrix * scale[:, None] * scale, slope * scale
    found = minimize(
        lambda x: 0.5 * x @ scaled @ x + right @ x,
        np.clip(np.zeros(len(slope)), low / scale, high / scale),
        jac=lambda x: scaled @ x + right,
        bounds=list(zip(low / scale, high / scale, strict=True)),
        method="L-BFGS-B",
        options={"maxiter": 20000, "ftol": 1e-15, "gtol": 1e-11, "maxcor": 50},
    )
    return np.asarray(found.x * scale)
