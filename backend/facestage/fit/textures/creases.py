"""Where a photo shows creases of the skin that the fitted shape does not have: dark lines."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import grey_closing, grey_dilation, grey_opening, map_coordinates

from facestage.contract.arrays import Bool, Float

# As shares of the face: a crease's shade is narrower than WIDTH and longer than LENGTH.
WIDTH, LENGTH = 0.05, 0.1
FACE_PX = 128.0  # of a larger face pixels are put together: creases have no finer shade
DIRECTIONS = 12
# Radiance that logarithms are taken above, as a share of the mean.
DARK_SHARE = 0.01


def crease_depth(
    pixels: Float[np.ndarray, "pixels 2"],
    photo: Float[np.ndarray, "pixels 3"],
    rendered: Float[np.ndarray, "pixels 3"],
    face_px: float,
) -> Float[np.ndarray, " pixels"]:
    """By how much log radiance of the ``photo`` over what is ``rendered`` lies, in dark lines at
    ``pixels``, below what is beside them; 0 where there is no line.

    What a closing fills (Serra 1982, the bottom hat), as far as segments of LENGTH lie in it: moles
    and freckles are shorter.
    """
    cell = max(1.0, face_px / FACE_PX)
    place = (pixels - pixels.min(axis=0)) / cell
    column, row = np.floor(place).astype(int).T
    width, height = int(column.max()) + 1, int(row.max()) + 1
    seen, expected = photo.mean(axis=1), rendered.mean(axis=1)
    floor = DARK_SHARE * max(float(expected.mean()), 1e-9)
    residual = np.log(np.maximum(seen, floor)) - np.log(np.maximum(expected, floor))
    where = row * width + column
    count = np.bincount(where, minlength=height * width)
    mean = np.bincount(where, residual, height * width) / np.maximum(count, 1)
    filled = bottom_hat(
        mean.reshape(height, width),
        (count > 0).reshape(height, width),
        max(3, round(WIDTH * face_px / cell)),
    )
    length = max(5, round(LENGTH * face_px / cell))
    lines = np.minimum(filled, _longest(grey_dilation(filled, (3, 3)), length))
    if cell == 1.0:
        return lines[row, column]
    return np.asarray(map_coordinates(lines, (place - 0.5)[:, ::-1].T, order=1, mode="nearest"))


def bottom_hat(
    values: Float[np.ndarray, "height width"], known: Bool[np.ndarray, "height width"], side: int
) -> Float[np.ndarray, "height width"]:
    """How far a closing by a square lifts what is ``known``; 0 where it has too little to go by."""
    nothing = float(values.min(initial=0.0)) - 1.0
    closed = grey_closing(np.where(known, values, nothing), (side, side))
    return np.where(known & (closed > nothing), np.maximum(closed - values, 0.0), 0.0)


def _longest(values: Float[np.ndarray, "height width"], length: int) -> np.ndarray:
    """The largest of the openings by segments of ``length`` in all directions."""
    half = length // 2
    steps = np.arange(-half, half + 1)
    result = np.zeros_like(values)
    for angle in np.pi * np.arange(DIRECTIONS) / DIRECTIONS:
        segment = np.zeros((2 * half + 1, 2 * half + 1), bool)
        segment[
            np.round(half + steps * np.sin(angle)).astype(int),
            np.round(half + steps * np.cos(angle)).astype(int),
        ] = True
        result = np.maximum(result, grey_opening(values, footprint=segment))
    return result
