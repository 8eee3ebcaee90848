"""Gaussian priors as residuals, in standard deviations, that are linear in an unknown's values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Float

LEVEL_MIN = 0.05  # of the usual level, below which a relative pattern counts as at that


@dataclass(frozen=True)
class Gaussian:
    """The residuals A x - b of the values x (n,); the energy is half the sum of their squares."""

    operator: sp.spmatrix  # A (r, n)
    offset: Float[np.ndarray, " residuals"]  # b (r,)

    def residuals(self, values: Float[np.ndarray, " values"]) -> Float[np.ndarray, " residuals"]:
        """The residuals of the ``values``."""
        return np.asarray(self.operator @ values - self.offset)

    def jacobian(
        self, values: Float[np.ndarray, " values"]
    ) -> Float[np.ndarray, "residuals values"]:
        """Their derivative, everywhere the same."""
        return np.asarray(self.operator.toarray())

    @cached_property
    def entries(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows, columns and values of A^T A where it is not 0, which every step needs."""
        found = (self.operator.T @ self.operator).tocoo()
        return found.row, found.col, found.data

    def add_to(
        self,
        hessian: Float[np.ndarray, "values values"],
        gradient: Float[np.ndarray, " values"],
        values: Float[np.ndarray, " values"],
    ) -> None:
        """Add the Hessian and the gradient of the energy at ``values``."""
        rows, columns, found = self.entries
        hessian[rows, columns] += found
        gradient += self.operator.T @ self.residuals(values)

    def scaled(self, factor: float) -> Gaussian:
        """With ``factor`` times each residual."""
        return self if factor == 1.0 else Gaussian(self.operator * factor, self.offset * factor)


def independent(
    count: int, mean: float | Float[np.ndarray, " ..."], sigma: float | Float[np.ndarray, " ..."]
) -> Gaussian:
    """``mean`` and ``sigma`` of all of ``count`` values, or of each (count,)."""
    inverse = np.broadcast_to(1.0 / np.asarray(sigma), count)
    return Gaussian(_diagonal(inverse), mean * inverse)


def tied(prior: Gaussian, ties: Float[np.ndarray, "ties values"]) -> Gaussian:
    """``prior`` of values of which the sums ``ties`` are 0, in standard deviations, besides."""
    operator = sp.vstack([prior.operator, sp.csr_matrix(ties)]).tocsr()
    return Gaussian(operator, np.concatenate([prior.offset, np.zeros(len(ties))]))


def level(count: int, mean: float, sigma: float) -> Gaussian:
    """``count`` values count as one observation of their ``mean``, however many they are."""
    spread = sigma * np.sqrt(count)
    return Gaussian(_diagonal(np.full(count, 1.0 / spread)), np.full(count, mean / spread))


@cache
def smooth(count: int, sigma: float) -> Gaussian:
    """Neighbours on a square map of ``count`` texels, row by row, differ by ``sigma``."""
    side = math.isqrt(count)
    if side < 2:
        return Gaussian(sp.csr_matrix((0, count)), np.zeros(0))
    ones = np.ones(side - 1)
    step = sp.diags([-ones, ones], [0, 1], shape=(side - 1, side))
    unit = sp.identity(side)
    differences = sp.vstack([sp.kron(unit, step), sp.kron(step, unit)]).tocsr()
    return Gaussian(differences * (1.0 / sigma), np.zeros(differences.shape[0]))


@dataclass(frozen=True)
class Relative:
    """The residuals A x / m of the values x, m being their mean: of a pattern, whatever its level.

    Neighbours that must not differ would else like a map best that is 0 all over, at which the
    light makes up for it, and the skin for the light.
    """

    pattern: Gaussian
    mean: float  # the level at which the pattern's own standard deviations hold

    def scaled(self, factor: float) -> Relative:
        """With ``factor`` times each residual."""
        return Relative(self.pattern.scaled(factor), self.mean)

    def residuals(self, values: Float[np.ndarray, " values"]) -> Float[np.ndarray, " residuals"]:
        """The residuals of the ``values``."""
        return self.pattern.residuals(values) / self._level(values)

    def jacobian(
        self, values: Float[np.ndarray, " values"]
    ) -> Float[np.ndarray, "residuals values"]:
        """Their derivative."""
        by_level = self.residuals(values)[:, None] * self._by_value(values)
        return self.pattern.jacobian(values) / self._level(values) - by_level

    def add_to(
        self,
        hessian: Float[np.ndarray, "values values"],
        gradient: Float[np.ndarray, " values"],
        values: Float[np.ndarray, " values"],
    ) -> None:
        """Add the Hessian (Gauss-Newton) and the gradient of the energy at ``values``."""
        level, residuals, by = self._level(values), self.residuals(values), self._by_value(values)
        slope = self.pattern.operator.T @ residuals / level
        squares = float(residuals @ residuals)
        rows, columns, found = self.pattern.entries
        hessian[rows, columns] += found / level**2
        both = by * slope - 0.5 * squares * by**2
        # Nothing where all values are alike, as at first; in place, because a map has many.
        if both.any():
            hessian -= both
            hessian -= both[:, None]
        gradient += slope - squares * by

    def _level(self, values: np.ndarray) -> float:
        return max(float(values.mean()) / self.mean, LEVEL_MIN)

    def _by_value(self, values: np.ndarray) -> float:
        """D log level / d value."""
        level = self._level(values)
        return 0.0 if level == LEVEL_MIN else 1.0 / (self.mean * len(values) * level)


def _diagonal(values: Float[np.ndarray, " values"]) -> sp.csr_matrix:
    """``values`` (n,) on the diagonal; ``sp.diags`` takes four times as long."""
    count = len(values)
    places = np.arange(count), np.arange(count + 1)
    return sp.csr_matrix((np.array(values, np.float64), *places), (count, count))
