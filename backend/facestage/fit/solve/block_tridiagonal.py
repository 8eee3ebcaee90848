"""Symmetric positive definite block-tridiagonal systems: forwards and backwards, as smoothers do.

T blocks of m unknowns cost O(T m^3), and every block of the inverse that is asked for comes out of
the same two sweeps (Rauch, Tung and Striebel 1965, in information form). In time an unknown is tied
to itself alone, so a block below the diagonal is k x k diagonal matrices, and nothing that is as
large as a block is multiplied with one on the way forwards.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotri

from facestage.fit.solve.cholesky import firm_cholesky

# Relative to a unit diagonal: keeps what nothing holds invertible, its deviation large.
RIDGE = 1e-12


@dataclass(frozen=True, eq=False)
class _Link:
    """A block below the diagonal, of rows and columns that have a part in the system: row r holds
    ``factors[j, r]`` in column ``columns[j, r]``, for each j below k.
    """

    columns: np.ndarray  # (k, rows) int
    factors: np.ndarray  # (k, rows)

    @classmethod
    def of(cls, ties: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> _Link:
        """From ``ties`` (k, k, n) and the unknowns (indices into k n) of rows and columns."""
        groups, _, size = ties.shape
        place = _places(columns, groups * size)
        group, unknown = np.divmod(rows, size)
        found = place[np.arange(groups)[:, None] * size + unknown]
        factors = np.where(found < 0, 0.0, ties[group, :, unknown].T)
        return cls(np.maximum(found, 0), factors)

    def times(self, right: np.ndarray) -> np.ndarray:
        """The block times ``right`` (columns, x)."""
        return sum(
            factor[:, None] * right[column]
            for column, factor in zip(self.columns, self.factors, strict=True)
        )

    def transposed(self, right: np.ndarray, columns: int) -> np.ndarray:
        """The block, of so many ``columns``, transposed, times ``right`` (rows,)."""
        return np.bincount(self.columns.ravel(), (self.factors * right).ravel(), columns)


class BlockTridiagonal:
    """The inverses of what is left of each diagonal block when all blocks before it are
    eliminated.
    """

    def __init__(self, diagonal: Iterable[np.ndarray], ties: np.ndarray, free: np.ndarray) -> None:
        """``diagonal``: T blocks (m, m) of m = k n unknowns, asked for one by one. ``ties``
        (T - 1, k, k, n): of the block (t + 1, t), entry (i n + u, j n + u) is ``ties[t, i, j, u]``,
        all others are 0. What is not ``free`` (T, m) bool, or has no diagonal entry at all, has no
        part in the system.
        """
        self._ties = ties
        self._kept: list[np.ndarray] = []  # indices of the unknowns of each block
        self._inverses: list[np.ndarray] = []  # of those alone
        # The blocks below the diagonal, of those alone; None where nothing is tied.
        self._links: list[_Link | None] = []
        # C S^-1, with S what is left of a block, and C the one below it.
        self._linked: list[np.ndarray | None] = []
        for t, block in enumerate(diagonal):
            own = block.diagonal()
            kept = np.flatnonzero(free[t] & (own > 0))
            self._kept.append(kept)
            scale = 1.0 / np.sqrt(own[kept])
            left = block[kept[:, None], kept]
            before = self._kept[t - 1] if t else kept[:0]
            if len(before) and ties[t - 1].any():
                link = _Link.of(ties[t - 1], kept, before)
                linked = link.times(self._inverses[t - 1])
                left -= link.times(linked.T)
                self._links.append(link)
                self._linked.append(linked)
            elif t:
                self._links.append(None)
                self._linked.append(None)
            left *= scale[:, None] * scale
            left[np.diag_indices(len(kept))] += RIDGE
            self._inverses.append(_inverse(left) * (scale[:, None] * scale))

    def solve(self, right: np.ndarray) -> np.ndarray:
        """(T, m), the solution x of A x = ``right`` (T, m); 0 of what has no part in it."""
        rest = [values[kept] for values, kept in zip(right, self._kept, strict=True)]
        for t, linked in enumerate(self._linked):
            if linked is not None:
                rest[t + 1] -= linked @ rest[t]
        result = np.zeros_like(right)
        after = np.zeros(0)
        for t in range(len(rest) - 1, -1, -1):
            link = self._links[t] if t < len(self._links) else None
            if link is not None:
                rest[t] -= link.transposed(after, len(rest[t]))
            after = self._inverses[t] @ rest[t]
            result[t, self._kept[t]] = after
        return result

    def covariance(self) -> tuple[np.ndarray, np.ndarray]:
        """Of A's inverse, the entries between an unknown and itself, laid out as ``ties`` are:
        (i n + u, j n + u) of each diagonal block t (T, k, k, n), and of the blocks (t + 1, t)
        (T - 1, k, k, n). 0 of what has no part in it.
        """
        beside, own = np.zeros_like(self._ties), np.zeros((len(self._kept), *self._ties.shape[1:]))
        for t, found, between in self._backwards():
            kept = self._kept[t]
            if between is not None:
                beside[t] = _with_itself(between, self._kept[t + 1], kept, beside[t].shape)
            own[t] = _with_itself(found, kept, kept, own[t].shape)
        return own, beside

    def diagonal_blocks(self) -> np.ndarray:
        """(T, m, m), those of A's inverse, whole. 0 of what has no part in it."""
        size = self._ties.shape[1] * self._ties.shape[3]
        result = np.zeros((len(self._kept), size, size))
        for t, found, _ in self._backwards():
            kept = self._kept[t]
            result[t][kept[:, None], kept] = found
        return result

    def _backwards(self) -> Iterator[tuple[int, np.ndarray, np.ndarray | None]]:
        """Of A's inverse, the last block first: t, the block (t, t), and the block (t + 1, t) where
        the two are tied, both of the unknowns that have a part in it.
        """
        after = np.zeros((0, 0))
        for t in range(len(self._kept) - 1, -1, -1):
            found, between = self._inverses[t], None
            linked = self._linked[t] if t < len(self._linked) else None
            if linked is not None:
                between = -(after @ linked)
                found = found - linked.T @ between
            yield t, found, between
            after = found


def _places(kept: np.ndarray, size: int) -> np.ndarray:
    """(size,) int, where each unknown is among the ``kept``; -1: nowhere."""
    result = np.full(size, -1)
    result[kept] = np.arange(len(kept))
    return result


def _with_itself(
    block: np.ndarray, rows: np.ndarray, columns: np.ndarray, shape: tuple[int, ...]
) -> np.ndarray:
    """The entries of a ``block`` of some ``rows`` and ``columns`` between an unknown and itself."""
    groups, _, size = shape
    result = np.zeros(shape)
    if not block.size:
        return result
    row, column = (
        _places(kept, groups * size).reshape(groups, size)[index]
        for kept, index in ((rows, np.s_[:, None]), (columns, np.s_[None]))
    )
    both = (row >= 0) & (column >= 0)
    row, column = np.broadcast_arrays(row, column)
    result[both] = block[row[both], column[both]]
    return result


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Of a symmetric positive definite matrix of unit diagonal."""
    if not len(matrix):
        return matrix
    inverse, _ = dpotri(firm_cholesky(matrix, 10 * RIDGE)[0], lower=1)
    lower = np.tri(len(matrix), dtype=bool)
    return np.where(lower, inverse, inverse.T)
