"""Symmetric positive definite block-tridiagonal systems: forwards and backwards, as smoothers do.

T blocks of m unknowns cost O(T m^3), and every block of the inverse that is asked for comes out of
the same two sweeps (Rauch, Tung and Striebel 1965, in information form).
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cho_solve
from scipy.linalg.lapack import dpotri

from facestage.fit.solve.cholesky import firm_cholesky

# Relative to a unit diagonal: keeps what nothing holds invertible, its deviation large.
RIDGE = 1e-12


class BlockTridiagonal:
    """The factors of a matrix A whose blocks are ``diagonal`` (T, m, m) and, below them, ``lower``.

    ``lower[t]`` (m, m) is block (t + 1, t). What has no diagonal entry at all has none in the
    solution.
    """

    def __init__(self, diagonal: np.ndarray, lower: np.ndarray) -> None:
        own = np.einsum("tii->ti", diagonal)
        self._scale = np.where(own > 0, 1.0 / np.sqrt(np.maximum(own, 1e-300)), 0.0)  # (T, m)
        self._factors = []
        # G_t = S_t^-1 C_t^T, with S_t what is left of block t when all before it is eliminated.
        self._gains: list[np.ndarray] = []
        count = diagonal.shape[1]
        carried = np.zeros((count, count))
        for t, block in enumerate(diagonal):
            scale = self._scale[t]
            left = block * scale[:, None] * scale - carried
            left[np.diag_indices(count)] = np.where(scale > 0, np.diag(left) + RIDGE, 1.0)
            factor = firm_cholesky(left, 10 * RIDGE)
            self._factors.append(factor)
            if t < len(lower):
                link = lower[t] * self._scale[t + 1][:, None] * scale
                gain = cho_solve(factor, link.T, check_finite=False)
                self._gains.append(gain)
                carried = link @ gain

    def solve(self, right: np.ndarray) -> np.ndarray:
        """The x of A x = ``right``."""
        eliminated: list[np.ndarray] = []
        for t, scale in enumerate(self._scale):
            rest = right[t] * scale
            eliminated.append(rest - self._gains[t - 1].T @ eliminated[-1] if t else rest)
        result = np.empty_like(self._scale)
        for t in range(len(result) - 1, -1, -1):
            result[t] = cho_solve(self._factors[t], eliminated[t], check_finite=False)
            if t < len(self._gains):
                result[t] -= self._gains[t] @ result[t + 1]
        return result * self._scale

    def covariance(self) -> tuple[np.ndarray, np.ndarray]:
        """Of A's inverse, the blocks on the diagonal (T, m, m) and those (t, t + 1) beside it."""
        count, width = self._scale.shape
        own = np.empty((count, width, width))
        beside = np.empty((len(self._gains), width, width))
        for t in range(count - 1, -1, -1):
            own[t] = _inverse(self._factors[t][0])
            if t < len(self._gains):
                beside[t] = -self._gains[t] @ own[t + 1]
                own[t] -= beside[t] @ self._gains[t].T
        # In place: a long film's take more memory than all else.
        scale = self._scale
        for blocks, first in ((own, 0), (beside, 1)):
            blocks *= scale[: len(blocks), :, None]
            blocks *= scale[first:, None]
        return own, beside


def _inverse(factor: np.ndarray) -> np.ndarray:
    """Of a matrix, from its lower Cholesky factor."""
    inverse, _ = dpotri(factor, lower=1)
    lower = np.tril(inverse)
    return np.asarray(lower + np.tril(lower, -1).T)
