"""Weighted sums of a few rows of an array, for many points at once."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Float, Int, Num


def mixed(
    weights: Float[np.ndarray, "points few"],
    index: Int[np.ndarray, "points few"],
    values: Num[np.ndarray, "rows ..."],
) -> Float[np.ndarray, "points ..."]:
    """The sums of ``weights`` times the rows of ``values`` that ``index`` names.

    As a sparse product, several times faster than a sum over rows that are gathered first.
    """
    points, few = index.shape
    pick = sp.csr_matrix(
        (weights.ravel(), index.ravel(), np.arange(0, points * few + 1, few, dtype=index.dtype)),
        shape=(points, len(values)),
    )
    found = pick @ values.reshape(len(values), -1)
    return np.asarray(found).reshape(points, *values.shape[1:])
