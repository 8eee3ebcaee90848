"""How much a pixel's residual says: its scale and correlation, estimated from the residuals
themselves.

A face model never explains a photograph to the last pore: residuals of a misfit albedo are large,
proportional to the radiance and correlated over many pixels. Treating each pixel as an independent
observation would let that misfit push the geometry away from what the landmarks know.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from facestage.contract.arrays import Bool, Float

# Residuals are relative to the local radiance plus this share of the face's mean radiance.
FLOOR_SHARE = 0.15
SIGMA_MIN = 0.005
# Where a highlight falls depends on where the lamp really is, not on the nearest light of the
# lattice: its radiance is uncertain by this share, or the geometry would bend to move it.
HIGHLIGHT_SHARE = 0.1
CAUCHY_SCALE = 2.5  # standard deviations
# Three channels of skin say no more than one about what the model misses: shape, shadow, occlusion.
CHANNEL_CORRELATION = 3.0
AREA_MIN, AREA_SHARE_MAX = 4.0, 0.02
# Misfits of shading and albedo are as large as a cheek, whatever the resolution: a quarter of the
# face.
BLOCK_SHARE = 0.25
# Where the residuals around a pixel (a window of this share of the face) exceed the face's own
# scale by more than this factor, the model lacks what is there: a beard, a hand, an unknown shadow.
# Its scale grows by this power of the excess, so that a whole region which is wrong counts for next
# to nothing, not only its worst pixels.
REGION_SHARE, REGION_EXCESS, REGION_POWER = 0.06, 2.5, 3.0
REGION_CLIP = 6.0  # standard deviations at most that one pixel adds to its region


@dataclass(frozen=True)
class NoiseModel:
    """Scale and correlation of the residuals of one evaluation."""

    sigma: float  # relative residual scale
    area: float  # pixels that count as one observation
    floor: float  # radiance
    # at least 1, how many times larger than the face's scale that of a pixel's region counts
    excess: Float[np.ndarray, "height width"]

    def scale(
        self,
        photo: Float[np.ndarray, "height width 3"],
        residual: Float[np.ndarray, "height width 3"],
        highlight: Float[np.ndarray, "height width 1"],
    ) -> Float[np.ndarray, "height width 1"]:
        """The radiance of one standard deviation where the model is ``photo`` +
        ``residual``.

        ``highlight`` is the model's specular part.
        """
        return self.excess[..., None] * (
            self.sigma * _level(photo, residual, self.floor) + HIGHLIGHT_SHARE * highlight
        )

    def information(self) -> float:
        """Weight of one pixel's channel after correlation."""
        return 1.0 / (self.area * CHANNEL_CORRELATION)

    def robust(
        self, standardized: Float[np.ndarray, "*pixels 3"]
    ) -> Float[np.ndarray, "*pixels 1"]:
        """Cauchy weights of residuals in standard deviations, shared by the channels."""
        squared = np.mean(standardized**2, axis=-1, keepdims=True)
        return 1.0 / (1.0 + squared / CAUCHY_SCALE**2)


def estimate_noise(
    residual: Float[np.ndarray, "height width 3"],
    photo: Float[np.ndarray, "height width 3"],
    used: Bool[np.ndarray, "height width"],
) -> NoiseModel:
    """Noise of ``residual``, the model minus ``photo``, where ``used``."""
    if not used.any():
        return NoiseModel(SIGMA_MIN, AREA_MIN, 1.0, np.ones(used.shape))
    floor = max(FLOOR_SHARE * float(photo[used].mean()), 1e-6)
    relative = residual / _level(photo, residual, floor)
    sigma = max(1.4826 * float(np.median(np.abs(relative[used]))), SIGMA_MIN)
    clipped = np.where(used[..., None], np.clip(relative, -2.5 * sigma, 2.5 * sigma), 0.0)
    return NoiseModel(
        sigma, _correlation_area(clipped, used), floor, _regional_excess(relative / sigma, used)
    )


def _regional_excess(
    standardized: Float[np.ndarray, "height width 3"], used: Bool[np.ndarray, "height width"]
) -> Float[np.ndarray, "height width"]:
    """The factor on the scale from the RMS of ``standardized`` residuals around each
    pixel.
    """
    width = REGION_SHARE * float(np.sqrt(used.sum()))
    inside = used.astype(float)
    squared = np.mean(np.clip(standardized, -REGION_CLIP, REGION_CLIP) ** 2, axis=-1) * inside
    around = gaussian_filter(squared, width) / np.maximum(gaussian_filter(inside, width), 1e-3)
    return np.maximum(np.sqrt(around) / REGION_EXCESS, 1.0) ** REGION_POWER


def _level(
    photo: Float[np.ndarray, "*pixels 3"], residual: Float[np.ndarray, "*pixels 3"], floor: float
) -> Float[np.ndarray, "*pixels 1"]:
    """The radiance that errors are relative to: midway between model and photo.

    Relative to the photo alone, black would be wrong by 1 at most and white without limit: a poor
    fit would escape into the dark. Midway, too dark and too bright cost the same.
    """
    return (photo + 0.5 * residual).mean(axis=-1, keepdims=True) + floor


def _correlation_area(
    residual: Float[np.ndarray, "height width 3"], used: Bool[np.ndarray, "height width"]
) -> float:
    """Pixels per independent observation: variance of block means times block size over pixel
    variance.
    """
    height, width = used.shape
    block = max(round(BLOCK_SHARE * float(np.sqrt(used.sum()))), 2)
    rows, columns = max(height // block, 1), max(width // block, 1)
    tall, wide = min(block, height), min(block, width)

    def blocks(array: np.ndarray) -> np.ndarray:
        return (
            array[: rows * tall, : columns * wide]
            .reshape(rows, tall, columns, wide)
            .sum(axis=(1, 3))
        )

    count = blocks(used.astype(float))
    full = count > 0.5 * tall * wide
    pixels = float(used.sum())
    variance = float((residual[used] ** 2).mean())
    upper = max(AREA_SHARE_MAX * pixels, AREA_MIN)
    if full.sum() < 4 or variance <= 0:
        return min(block**2 / 4.0, upper)
    means = np.mean(
        [(blocks(residual[..., channel])[full] / count[full]) ** 2 for channel in range(3)]
    )
    return float(np.clip(means * count[full].mean() / variance, AREA_MIN, upper))
