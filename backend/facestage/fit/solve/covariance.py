"""The covariance that normal equations hold, and what is left of them when some unknowns are not
asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_solve

from facestage.fit.solve.cholesky import firm_cholesky

# Relative to a unit diagonal: keeps null directions of the system invertible, their deviation
# large.
RIDGE = 1e-12


@dataclass(frozen=True, eq=False)
class Posterior:
    """Laplace's approximation: what is known of the ``active`` (size,) entries by the Hessian
    (size, size) of all terms and by that of the priors alone. Each is inverted once, however many
    ask.
    """

    hessian: np.ndarray
    prior_hessian: np.ndarray
    active: np.ndarray

    @cached_property
    def after(self) -> np.ndarray:
        """(size, size) covariance after the data, see :func:`covariance`."""
        return covariance(self.hessian, self.active)

    @cached_property
    def before(self) -> np.ndarray:
        """(size, size) covariance by the priors alone."""
        return covariance(self.prior_hessian, self.active)


def covariance(hessian: np.ndarray, active: np.ndarray) -> np.ndarray:
    """(size, size) inverse of ``hessian`` over the ``active`` (size,) entries whose diagonal is not
    0.

    Rows and columns of the others are 0; on the diagonal an active entry that nothing holds has
    infinity.
    """
    result = np.zeros_like(hessian, dtype=float)
    diagonal = np.diag(hessian)
    index = np.flatnonzero(active & (diagonal > 0))
    if len(index):
        scale = 1.0 / np.sqrt(diagonal[index])
        matrix = hessian[np.ix_(index, index)] * scale[:, None] * scale[None, :]
        matrix[np.diag_indices_from(matrix)] += RIDGE
        inverse = cho_solve(
            firm_cholesky(matrix, 10 * RIDGE), np.eye(len(index)), check_finite=False
        )
        result[np.ix_(index, index)] = inverse * scale[:, None] * scale[None, :]
    open_entries = np.flatnonzero(active & (diagonal <= 0))
    result[open_entries, open_entries] = np.inf
    return result


def marginal_hessian(hessian: np.ndarray, kept: np.ndarray, free: np.ndarray) -> np.ndarray:
    """(k, k) Hessian over the ``kept`` (k,) indices when all other ``free`` (size,) entries are
    unknown.

    Its inverse is the block of the whole inverse: the Schur complement.
    """
    other = free & (np.diag(hessian) > 0)
    other[kept] = False
    index = np.flatnonzero(other)
    result = hessian[np.ix_(kept, kept)]
    if len(index):
        scale = 1.0 / np.sqrt(np.diag(hessian)[index])
        matrix = hessian[np.ix_(index, index)] * scale[:, None] * scale[None, :]
        matrix[np.diag_indices_from(matrix)] += RIDGE
        cross = hessian[np.ix_(index, kept)] * scale[:, None]
        result = result - cross.T @ cho_solve(
            firm_cholesky(matrix, 10 * RIDGE), cross, check_finite=False
        )
    return result
