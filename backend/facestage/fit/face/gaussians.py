"""Gaussian priors as residuals, in standard deviations, that are linear in an unknown's values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Float
from facestage.fit.face.light_parameters import CHANNELS, LightParameters

# E_light, relative to the mean light: how much the channels of one light differ, and how bright it
# is. Lamps may be of any color; that all of them together tint the skin cannot be told from the
# skin's own color.
LIGHT_COLOR_SIGMA, LIGHT_LEVEL_SIGMA, LIGHT_TINT_SIGMA = 0.4, 3.0, 0.06


@dataclass(frozen=True)
class Gaussian:
    """The residuals A x - b of the values x (n,); the energy is half the sum of their squares."""

    operator: sp.spmatrix  # A (r, n)
    offset: Float[np.ndarray, " residuals"]  # b (r,)

    @cached_property
    def normal(self) -> sp.spmatrix:
        """(n, n) A^T A, which every step needs."""
        return (self.operator.T @ self.operator).tocsr()

    @property
    def hessian(self) -> Float[np.ndarray, "values values"]:
        """A^T A, dense."""
        return np.asarray(self.normal.toarray())

    def residuals(self, values: Float[np.ndarray, " values"]) -> Float[np.ndarray, " residuals"]:
        """The residuals of the ``values``."""
        return np.asarray(self.operator @ values - self.offset)

    def scaled(self, factor: float) -> Gaussian:
        """With ``factor`` times each residual."""
        return self if factor == 1.0 else Gaussian(self.operator * factor, self.offset * factor)


def independent(count: int, mean: float, sigma: float | Float[np.ndarray, " ..."]) -> Gaussian:
    """Each of ``count`` values has this ``mean``; ``sigma`` of all of them, or of each (count,)."""
    inverse = np.broadcast_to(1.0 / np.asarray(sigma), count)
    return Gaussian(_diagonal(inverse), mean * inverse)


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


def light_color(lights: LightParameters, mean: float) -> Gaussian:
    """E_light = sum_j |l_j - m_j|^2 (Dib et al. 2019, eq. 5), with a common tint and a weak level.

    ``mean``: the radiance that it is relative to.
    """
    count = int(lights.fitted.sum())
    if count == 0:
        return Gaussian(sp.csr_matrix((0, 0)), np.zeros(0))
    if lights.uniform:
        brightness = sp.identity(count) / (LIGHT_LEVEL_SIGMA * mean)
        color = sp.identity(CHANNELS) / LIGHT_TINT_SIGMA
        white = np.concatenate([np.zeros(count), np.full(CHANNELS, 1.0 / LIGHT_TINT_SIGMA)])
        return Gaussian(sp.block_diag([brightness, color]).tocsr(), white)
    centre = np.eye(CHANNELS) - 1.0 / CHANNELS
    color = sp.kron(sp.identity(count), centre / (LIGHT_COLOR_SIGMA * mean))
    tint = sp.kron(np.ones((1, count)), centre / (LIGHT_TINT_SIGMA * mean * count))
    brightness = sp.identity(count * CHANNELS) / (LIGHT_LEVEL_SIGMA * mean)
    operator = sp.vstack([color, tint, brightness]).tocsr()
    return Gaussian(operator, np.zeros(operator.shape[0]))


def _diagonal(values: Float[np.ndarray, " values"]) -> sp.csr_matrix:
    """``values`` (n,) on the diagonal; ``sp.diags`` takes four times as long."""
    count = len(values)
    places = np.arange(count), np.arange(count + 1)
    return sp.csr_matrix((np.array(values, np.float64), *places), (count, count))
