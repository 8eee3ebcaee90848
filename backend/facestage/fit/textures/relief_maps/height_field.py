"""Pigment and height of the skin, told apart: the most probable two fields over the texture.

A photo's residual of log radiance is a + g . grad h: pigment a changes it as it is, a height h
through the slopes, by derivatives g that the light decides. Both are Gaussian fields, of which each
octave of wavelengths varies alike: pigment in log albedo, height in slopes. In one photo, waves of
height that run along g are seen as well as pigment, those across not at all; in photos of several
lights what changes with the light is height.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.fft
from scipy.ndimage import distance_transform_edt, gaussian_filter

from facestage.contract.arrays import Bool, Float
from facestage.fit.textures.relief_maps.relief_evidence import Evidence, difference
from facestage.system.cores import cores

STEPS, TOLERANCE = 90, 0.01
PAD = 8  # texels around what is seen: the fields wrap around
# Wavelengths in mm up to which pigment and height vary as much in one octave as in another. Longer
# waves of height are light that is wrong, in one photo more than all that is right.
PIGMENT_LONGEST, HEIGHT_LONGEST = 30.0, 9.0
PIGMENT_SIGMA = 0.06  # of log albedo, all octaves together, where nothing is painted
# Freckles are sparse, pigment has longer tails than a Gaussian: where it is known roughly, as much
# is expected of it as was found, over this times the spread of an octave (reweighted least squares
# of a Student's t).
TAIL = 1.5


@dataclass(frozen=True)
class Spread:
    """Root mean squares of an octave of wavelengths."""

    pigment: float  # of log albedo
    slope: float  # of both slopes together


def solved(
    seen: Evidence,
    spacing: Float[np.ndarray, "size size"],
    spread: Spread,
    pigment: Float[np.ndarray, "size size"] | None = None,
) -> tuple[Float[np.ndarray, "size size"], Float[np.ndarray, "size size"]]:
    """Height in mm and pigment, 0 far from what is seen.

    ``spacing``: mm between texels. ``pigment``, where it is known roughly.
    """
    if pigment is not None:
        expected = PIGMENT_SIGMA * pigment / (TAIL * spread.pigment)
        seen = replace(seen, paint=np.hypot(seen.paint, expected))
    rows, columns = (_span(seen.weight.any(axis=axis)) for axis in (1, 0))
    result = np.zeros((2, *seen.weight.shape), np.float32)
    if rows.stop > rows.start:
        found = _Fields(seen.part(rows, columns), spacing[rows, columns], spread).solved()
        result[:, rows, columns] = found
    return result[1], result[0]


class _Fields:
    """The two fields, whitened: of unit variance and independent before there is a photo."""

    def __init__(
        self, seen: Evidence, spacing: Float[np.ndarray, "rows columns"], spread: Spread
    ) -> None:
        self.seen = Evidence(**{name: each.astype(np.float32) for name, each in vars(seen).items()})
        self.shape = spacing.shape
        mean = float(np.median(spacing[seen.weight > 0]))
        near = np.where(seen.weight > 0, spacing, 0.0)
        near = near[
            tuple(distance_transform_edt(near == 0, return_distances=False, return_indices=True))
        ]
        wide = gaussian_filter(near, 2.0) / mean
        paint = np.hypot(1.0, gaussian_filter(seen.paint, 1.0) / PIGMENT_SIGMA)
        self.scale = np.stack([paint, wide]).astype(np.float32)
        vertical = scipy.fft.fftfreq(self.shape[0])[:, None]
        horizontal = scipy.fft.rfftfreq(self.shape[1])[None]
        wave = 2 * np.pi * np.hypot(vertical, horizontal) / mean  # per mm
        octave = np.sqrt(2 * np.pi / np.log(2)) / mean
        pigment = 1 / np.hypot(wave, 2 * np.pi / PIGMENT_LONGEST)
        height = wave**2 / (wave**4 + (2 * np.pi / HEIGHT_LONGEST) ** 4)
        self.amplitude = np.stack(
            [spread.pigment * octave * pigment, spread.slope * octave * height]
        ).astype(np.float32)

    def colored(self, white: Float[np.ndarray, "2 rows columns"]) -> np.ndarray:
        """Pigment and height of whitened fields."""
        waves = scipy.fft.rfft2(white, axes=(1, 2), workers=cores())
        waves *= self.amplitude
        return scipy.fft.irfft2(waves, self.shape, axes=(1, 2), workers=cores()) * self.scale

    def whitened(self, by_fields: Float[np.ndarray, "2 rows columns"]) -> np.ndarray:
        """The transpose of :meth:`colored`."""
        waves = scipy.fft.rfft2(by_fields * self.scale, axes=(1, 2), workers=cores())
        waves *= self.amplitude
        return scipy.fft.irfft2(waves, self.shape, axes=(1, 2), workers=cores())

    def curvature(self, white: np.ndarray) -> np.ndarray:
        """What the whole quadratic energy's second derivative makes of a direction."""
        pigment, height = self.colored(white)
        right, below = difference(height, 1), difference(height, 0)
        seen = self.seen
        by_pigment = seen.weight * pigment + seen.slope[0] * right + seen.slope[1] * below
        by_right = seen.slope[0] * pigment + seen.slopes[0] * right + seen.slopes[1] * below
        by_below = seen.slope[1] * pigment + seen.slopes[1] * right + seen.slopes[2] * below
        return white + self.whitened(self._by_fields(by_pigment, by_right, by_below))

    def _by_fields(
        self, by_pigment: np.ndarray, by_right: np.ndarray, by_below: np.ndarray
    ) -> np.ndarray:
        # A central difference's transpose is its negative.
        by_height = -difference(by_right, 1) - difference(by_below, 0)
        return np.stack([by_pigment, by_height])

    def solved(self) -> np.ndarray:
        """(2, rows, columns) pigment and height, by conjugate gradients."""
        seen = self.seen
        right = self.whitened(self._by_fields(seen.value, *seen.slope_value))
        found, residual = np.zeros_like(right), right.copy()
        direction, energy = right.copy(), float((right**2).sum())
        goal = TOLERANCE**2 * energy
        for _ in range(STEPS):
            if energy <= goal:
                break
            image = self.curvature(direction)
            length = energy / max(float((direction * image).sum()), 1e-30)
            found += length * direction
            residual -= length * image
            before, energy = energy, float((residual**2).sum())
            direction = residual + energy / before * direction
        return self.colored(found)


def _span(seen: Bool[np.ndarray, " texels"]) -> slice:
    """Where anything is ``seen``, with room around it, of a length that transforms fast."""
    if not seen.any():
        return slice(0, 0)
    first, last = np.flatnonzero(seen)[[0, -1]]
    length = min(scipy.fft.next_fast_len(int(last - first) + 1 + 2 * PAD, real=True), len(seen))
    start = int(np.clip(first - PAD, 0, len(seen) - length))
    return slice(start, start + length)
