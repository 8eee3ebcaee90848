"""By how much a piece of a picture is displaced in another one, to a part of a pixel.

Normalised cross-correlation in Gaussian windows of what is finer than a few pixels, tried at every
displacement within reach: light changes slowly over skin, pores and moles do not. A peak's height
says how far the pieces agree, and its curvature how well each direction is known: with N
independent pixels in a window the likelihood of two pieces that correlate by r is
-N/2 log(1 - r^2) (that of a fit with unknown gain and noise).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.images.opencv import opencv

# Standard deviation of a window in pixels, and the area that it amounts to.
WINDOW_PX = 4.0
WINDOW_AREA = 4.0 * np.pi * WINDOW_PX**2
# A peak must correlate so far, and stand out so far over all others further away than this.
PEAK_MIN, LEAD_MIN, RIVAL_PX = 0.5, 0.05, 2
# How many times the noise texture must be.
TEXTURE_MIN = 3.0
CORRELATION_MAX = 0.995
# Share of a window that both pictures must show.
COVERED_MIN = 0.5


@dataclass(frozen=True)
class Band:
    """Which detail of a picture is compared, and what its correlation is worth."""

    smooth_px: float  # what is finer than this standard deviation is noise; 0: nothing is
    detail_px: float  # what is coarser is light
    # Standard deviation of the logarithm that is no texture: 8 bits of a mid grey are 0.01 apart, a
    # third of that, or less where pixels are averaged.
    noise: float
    # Of a window's pixels the share that is independent. What light leaves of its own in the detail
    # is correlated: with this share the true places, of a scanned head in three lights, lie about
    # as far off as the covariances say.
    independent: float


# Pores, and for photos whose noise hides them moles and hairs: those are placed half as well.
BANDS = (Band(0.0, 2.0, 0.004, 0.25), Band(0.7, 3.0, 0.003, 0.1))


@dataclass(frozen=True)
class Displacements:
    """For places of the first picture, rows and columns of them, where their surroundings are in
    the second.
    """

    shift: Float[np.ndarray, "rows columns 2"]  # x and y, pixels
    sure: Bool[np.ndarray, "rows columns"]  # a peak that stands out; else nothing is known
    # inverse of the shift's covariance
    information: Float[np.ndarray, "rows columns 2 2"]


def detail(
    picture: Float[np.ndarray, "height width"], seen: Bool[np.ndarray, "height width"], band: Band
) -> Float[np.ndarray, "height width"]:
    """What of ``picture`` lies in ``band``, 0 where it is not ``seen``."""
    fine = _mean(picture, seen, band.smooth_px) if band.smooth_px else picture
    result = fine - _mean(picture, seen, band.detail_px)
    return np.where(seen, result, 0.0).astype(np.float32)


def textured(
    details: Float[np.ndarray, "height width"], seen: Bool[np.ndarray, "height width"], band: Band
) -> Bool[np.ndarray, "height width"]:
    """Where a window has texture that stands out from the noise."""
    energy = _blurred(details**2, WINDOW_PX)
    covered = _blurred(seen.astype(np.float32), WINDOW_PX)
    return np.asarray(energy > (TEXTURE_MIN * band.noise) ** 2 * np.maximum(covered, 1e-3))


def kept_places(spacing: int) -> tuple[slice, slice]:
    """Rows and columns of a picture's pixels that lie ``spacing`` apart."""
    each = slice(spacing // 2, None, spacing)
    return each, each


def displacements(
    first: Float[np.ndarray, "height width"],
    second: Float[np.ndarray, "height width"],
    seen: Bool[np.ndarray, "height width"],
    reach: int,
    band: Band,
    spacing: int = 1,
) -> Displacements:
    """Of the details of two pictures that show the same where they are ``seen``, but for shifts of
    up to ``reach`` pixels; at the :func:`kept_places` of the first one's pixels.
    """
    at = kept_places(spacing)
    return _peaks(_correlations(first, second, seen, reach, band.noise, at), band.independent)


def surest(found: Sequence[Displacements]) -> Displacements:
    """Place by place the one that is known best."""
    strength = [
        np.where(one.sure, np.linalg.det(one.information), -1.0 - number)
        for number, one in enumerate(found)
    ]
    best = np.argmax(strength, axis=0)

    def chosen(parts: Sequence[np.ndarray]) -> np.ndarray:
        which = best.reshape(1, *best.shape, *(1,) * (parts[0].ndim - 2))
        return np.take_along_axis(np.stack(parts), which, axis=0)[0]

    return Displacements(
        chosen([one.shift for one in found]),
        chosen([one.sure for one in found]),
        chosen([one.information for one in found]),
    )


def _mean(picture: np.ndarray, seen: np.ndarray, sigma: float) -> np.ndarray:
    """Of what is ``seen`` around each pixel."""
    inside = seen.astype(np.float32)
    kept = np.where(seen, picture, 0.0).astype(np.float32)
    return np.asarray(_blurred(kept, sigma) / np.maximum(_blurred(inside, sigma), 1e-3))


def _blurred(image: np.ndarray, sigma: float) -> np.ndarray:
    """Zero around the image."""
    cv2 = opencv()
    return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT))


def _correlations(
    first: np.ndarray,
    second: np.ndarray,
    seen: np.ndarray,
    reach: int,
    deviation: float,
    at: tuple[slice, slice],
) -> Float[np.ndarray, "shifts shifts rows columns"]:
    """The correlation ``at`` these pixels by each shift, y first, from -reach to reach."""
    height, width = first.shape
    inside = seen.astype(np.float32)
    second = np.pad(second * inside, reach)
    shown, side = np.pad(inside, reach), 2 * reach + 1
    result = np.empty((side, side, *inside[at].shape), np.float32)
    for down in range(side):
        for right in range(side):
            where = slice(down, down + height), slice(right, right + width)
            both = inside * shown[where]
            a, b = first * both, second[where] * both
            sums = _blurred(np.stack([a * b, a * a, b * b, both], axis=-1), WINDOW_PX)
            product, of_first, of_second, covered = np.moveaxis(sums[at], -1, 0)
            noise = deviation**2 * covered + 1e-12
            correlation = product / np.sqrt((of_first + noise) * (of_second + noise))
            result[down, right] = correlation * np.minimum(1.0, covered / COVERED_MIN)
    return result


def _peaks(correlations: np.ndarray, independent: float) -> Displacements:
    """The highest correlation of each place, between the shifts that were tried by a parabola."""
    side, (height, width) = len(correlations), correlations.shape[2:]
    flat = correlations.reshape(side * side, height, width)
    row, column = np.divmod(flat.argmax(axis=0), side)
    y, x = np.mgrid[:height, :width]
    inside = (row > 0) & (row < side - 1) & (column > 0) & (column < side - 1)
    j, i = np.clip(row, 1, side - 2), np.clip(column, 1, side - 2)

    def beside(down: int, right: int) -> np.ndarray:
        return correlations[j + down, i + right, y, x].astype(np.float64)

    top = beside(0, 0)
    slope = 0.5 * np.stack([beside(0, 1) - beside(0, -1), beside(1, 0) - beside(-1, 0)], axis=-1)
    xx, yy = beside(0, 1) + beside(0, -1) - 2 * top, beside(1, 0) + beside(-1, 0) - 2 * top
    xy = 0.25 * (beside(1, 1) + beside(-1, -1) - beside(1, -1) - beside(-1, 1))
    curvature = -np.stack([np.stack([xx, xy], axis=-1), np.stack([xy, yy], axis=-1)], axis=-2)
    round_top = inside & (xx < 0) & (xx * yy - xy**2 > 1e-8)
    curvature = np.where(round_top[..., None, None], curvature, np.eye(2))
    offset = np.linalg.solve(curvature, slope[..., None])[..., 0]
    sure = round_top & (np.abs(offset) < 1).all(axis=-1)
    sure &= (top > PEAK_MIN) & (top - _rival(correlations, row, column) > LEAD_MIN)
    shift = np.stack([i, j], axis=-1) - (side // 2) + np.where(sure[..., None], offset, 0.0)
    r = np.clip(top, 0.0, CORRELATION_MAX)
    strength = independent * WINDOW_AREA * r / (1.0 - r**2)
    return Displacements(shift, sure, strength[..., None, None] * curvature)


def _rival(correlations: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """(rows, columns) the highest correlation that is no part of the highest peak."""
    result = np.full(row.shape, -1.0, np.float32)
    for down, line in enumerate(correlations):
        for right, one in enumerate(line):
            far = (np.abs(row - down) > RIVAL_PX) | (np.abs(column - right) > RIVAL_PX)
            np.maximum(result, one, out=result, where=far)
    return result
