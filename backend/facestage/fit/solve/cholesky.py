"""Cholesky factors of matrices that rounding, or too little data, leaves without one."""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_factor

# An eigenvalue that stands for none at all.
NOTHING = 1e-30


def firm_cholesky(matrix: np.ndarray, first: float = 1e-10) -> tuple[np.ndarray, bool]:
    """Lower factor of a symmetric ``matrix`` (n, n) of unit diagonal, for scipy's cho_solve.

    The diagonal grows until rounding allows a factor: by ``first``, then by ten times as much, ...

    Raises LinAlgError where no diagonal would do: ``matrix`` is not finite.
    """
    extra = 0.0
    while True:
        try:
            grown = matrix + extra * np.eye(len(matrix)) if extra else matrix
            return cho_factor(grown, lower=True, check_finite=False)
        except LinAlgError:
            if not np.isfinite(matrix).all():
                raise
            extra = max(10 * extra, first)


def with_ridge(matrix: np.ndarray, share: float) -> np.ndarray:
    """A symmetric ``matrix`` (n, n) plus ``share`` of its largest eigenvalue on the diagonal."""
    added = share * max(float(np.linalg.eigvalsh(matrix)[-1]), NOTHING)
    return matrix + added * np.eye(len(matrix))
