"""Light below the skin: irradiance comes out again around where it went in, red farther than blue.

Its profile (contract/scattering.py) is a function of the surface's Laplacian L: over a plane the
profile of distance d multiplies a wave of k radians a metre by

f(k^2) = 1/4 (1 + (d k)^2)^(-1/2) + 3/4 (1 + (3 d k)^2)^(-1/2),

so that over any surface f(L) spreads what is there, along the surface and never across a step of
depth. L is that of the triangles between the pixels (cotangent weights, Pinkall & Polthier 1993), f
a Chebyshev series: a product with a sparse matrix for each of its terms, of which only the factors
differ between the channels. f(0) = 1: light that is everywhere alike stays so.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Bool, Float, Float32, Int
from facestage.contract.scattering import DISTANCE_MM, METRES
from facestage.fit.face.light_parameters import CHANNELS

# What a triangle's slope against the line of sight may be of the steepest that its corners' normals
# say: less is a step of depth between them.
STEP_SLOPE = 0.6
COSINE_MIN = 0.05
# What all terms that are left out may add up to, and how many of them are looked for.
TAIL, TERMS_MAX = 2e-3, 256
# Of a wave as long as two pixels the Laplacian between pixels sees less than its k^2: on a square
# lattice of side h L = k^2 (1 - h^2 k^2 / 16 + ...) averaged over directions, and the largest L is
# 8 / h^2: k^2 = L (1 + 0.5 L / largest + ...), with 0.8 for the terms that follow.
LATTICE = 0.8


@runtime_checkable
class Spread(Protocol):
    """How irradiance spreads below the pixels of one surface."""

    def lit(
        self, diffuse: Float[np.ndarray, "pixels lights"], radiance: Float[np.ndarray, "lights 3"]
    ) -> Float[np.ndarray, "pixels 3"]:
        """What comes out of ``diffuse``, by lights at unit radiance, under lights of this."""

    def by_light(
        self, diffuse: Float[np.ndarray, "pixels lights"]
    ) -> Float32[np.ndarray, "3 pixels lights"]:
        """What comes out of ``diffuse``, in each channel."""


def spectrum(
    squares: Float[np.ndarray, " waves"], strength: float
) -> tuple[Float[np.ndarray, "waves 3"], Float[np.ndarray, "waves 3"]]:
    """What is left of waves of these k^2 (1/m^2) in each channel, and how that changes with the
    strength.
    """
    distance = strength * METRES * np.array(DISTANCE_MM)
    value, slope = (np.zeros((len(squares), CHANNELS)) for _ in range(2))
    for share, times in ((0.25, 1.0), (0.75, 3.0)):
        wave = squares[:, None] * (times * distance) ** 2
        value = value + share / np.sqrt(1 + wave)
        slope = slope - share * wave / (1 + wave) ** 1.5
    return value, slope / max(strength, 1e-9)


@dataclass(frozen=True)
class Scattering:
    """f(L) over the pixels of a surface."""

    laplacian: sp.csr_matrix  # (pixels, pixels) 1/m^2, rows of what is no skin are empty
    strength: float

    @classmethod
    def over(
        cls,
        pixels: Float[np.ndarray, "pixels 2"],
        points: Float[np.ndarray, "pixels 3"],
        rays: Float[np.ndarray, "pixels 3"],
        normals: Float[np.ndarray, "pixels 3"],
        skin: Bool[np.ndarray, " pixels"],
        strength: float,
    ) -> Scattering:
        """Over ``points`` that ``pixels`` on a square lattice see along ``rays``, of which only
        ``skin`` takes part.
        """
        return cls(_laplacian(pixels, points, rays, normals, skin), strength)

    @cached_property
    def _largest(self) -> float:
        """No eigenvalue is larger (Gershgorin)."""
        rows = np.asarray(abs(self.laplacian).sum(axis=1)).ravel()
        return max(float(rows.max(initial=0.0)), 1e-9)

    @cached_property
    def _series(self) -> tuple[Float[np.ndarray, "terms 3"], Float[np.ndarray, "terms 3"]]:
        """Factors of the Chebyshev polynomials of 2 L / largest - 1, and their derivatives."""
        angle = np.pi * (np.arange(TERMS_MAX) + 0.5) / TERMS_MAX
        share = 0.5 * (1 + np.cos(angle))
        squares = self._largest * share * (1 + LATTICE * share)
        sampled = spectrum(squares, self.strength)
        transform = 2 / TERMS_MAX * np.cos(np.outer(np.arange(TERMS_MAX), angle))
        transform[0] *= 0.5
        value, slope = (transform @ each for each in sampled)
        tail = np.cumsum(np.abs(value[::-1]).max(axis=1))[::-1]
        count = max(int((tail > TAIL).sum()), 2)
        value, slope = value[:count].copy(), slope[:count].copy()
        # At L = 0, where every polynomial is 1 or -1, what is left out would change the light.
        sign = (-1.0) ** np.arange(count)
        value[0] += 1 - sign @ value
        slope[0] -= sign @ slope
        return value, slope

    def lit(
        self, diffuse: Float[np.ndarray, "pixels lights"], radiance: Float[np.ndarray, "lights 3"]
    ) -> Float[np.ndarray, "pixels 3"]:
        """See :class:`Spread`."""
        return self.channels(diffuse @ radiance)

    def channels(self, values: Float[np.ndarray, "pixels 3"]) -> Float[np.ndarray, "pixels 3"]:
        """Each channel spread."""
        return self._sum(values, self._series[0])

    def by_strength(self, values: Float[np.ndarray, "pixels 3"]) -> Float[np.ndarray, "pixels 3"]:
        """The derivative of :meth:`channels` by the strength."""
        return self._sum(values, self._series[1])

    def _sum(
        self, values: Float[np.ndarray, "pixels 3"], factors: Float[np.ndarray, "terms 3"]
    ) -> Float[np.ndarray, "pixels 3"]:
        result = np.zeros(values.shape)
        for factor, term in zip(factors, self._terms(values, len(factors)), strict=True):
            result += factor * term
        return result

    def by_light(
        self, diffuse: Float[np.ndarray, "pixels ..."]
    ) -> Float32[np.ndarray, "3 pixels ..."]:
        """See :class:`Spread`."""
        factors = self._series[0].astype(np.float32)
        flat = diffuse.reshape(len(diffuse), -1)
        result = np.zeros((CHANNELS, *flat.shape), np.float32)
        for factor, term in zip(factors, self._terms(flat, len(factors)), strict=True):
            for channel in range(CHANNELS):
                result[channel] += factor[channel] * term
        return result.reshape(CHANNELS, *diffuse.shape)

    def _terms(
        self, values: Float[np.ndarray, "pixels columns"], count: int
    ) -> Iterator[Float[np.ndarray, "pixels columns"]]:
        """T_k(2 L / largest - 1) values, k = 0, 1, ..."""
        before, now = values, self._operator @ values
        yield before
        yield now
        for _ in range(count - 2):
            before, now = now, 2 * (self._operator @ now) - before
            yield now

    @cached_property
    def _operator(self) -> sp.csr_matrix:
        scaled = self.laplacian * (2.0 / self._largest)
        return sp.csr_matrix((scaled - sp.identity(scaled.shape[0])).astype(np.float32))


def _laplacian(
    pixels: Float[np.ndarray, "pixels 2"],
    points: Float[np.ndarray, "pixels 3"],
    rays: Float[np.ndarray, "pixels 3"],
    normals: Float[np.ndarray, "pixels 3"],
    skin: Bool[np.ndarray, " pixels"],
) -> sp.csr_matrix:
    count = len(pixels)
    corners = _triangles(pixels, skin)
    a, b, c = (points[corners[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    double = np.linalg.norm(normal, axis=1)
    slope = np.abs(np.einsum("tx,tx->t", normal, rays[corners[:, 0]]))
    steepest = np.abs(np.einsum("px,px->p", normals, rays))[corners].max(axis=1)
    flat = slope > double * np.maximum(STEP_SLOPE * steepest, COSINE_MIN)
    corners, double = corners[flat], double[flat]
    rows, columns, values = [], [], []
    area = np.zeros(count)
    for first in range(3):
        i, j, k = (corners[:, (first + turn) % 3] for turn in range(3))
        area += np.bincount(i, double / 6, count)
        # The cotangent at i is the weight of the edge from j to k.
        weight = 0.5 * np.einsum("tx,tx->t", points[j] - points[i], points[k] - points[i]) / double
        rows += [j, k, j, k]
        columns += [k, j, j, k]
        values += [-weight, -weight, weight, weight]
    shape = (count, count)
    stiffness = sp.csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape
    )
    # A pixel with few triangles would make the series long.
    least = 0.5 * float(np.median(area[area > 0])) if (area > 0).any() else 1.0
    return sp.csr_matrix(sp.diags_array(1 / np.maximum(area, least)) @ stiffness)


def _triangles(
    pixels: Float[np.ndarray, "pixels 2"], skin: Bool[np.ndarray, " pixels"]
) -> Int[np.ndarray, "triangles 3"]:
    """Two in each square of neighbouring pixels that are all of ``skin``, one where three are."""
    column, row = (np.unique(each, return_inverse=True) for each in pixels.T)
    x, y = (_steps(values)[index] for values, index in (column, row))
    index = np.full((y.max(initial=0) + 1, x.max(initial=0) + 1), -1)
    index[y[skin], x[skin]] = np.flatnonzero(skin)
    quads = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1)
    quads = quads.reshape(-1, 4)
    missing = (quads < 0).sum(axis=1)
    whole = quads[missing == 0]
    split = [whole[:, [0, 1, 2]], whole[:, [0, 2, 3]]]
    three = quads[missing == 1]
    return np.concatenate([*split, three[three >= 0].reshape(-1, 3)])


def _steps(values: Float[np.ndarray, " values"]) -> Int[np.ndarray, " values"]:
    """Ascending multiples of a step, counted from 0."""
    step = np.diff(values).min(initial=np.inf)
    return (
        np.zeros(len(values), int)
        if len(values) < 2
        else np.round((values - values[0]) / step).astype(int)
    )
