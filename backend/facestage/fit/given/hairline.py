"""Whether anything is seen to change where hair is said to begin."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates

# The least that looks change by across a hairline, of what a face's change by over such a way:
# 0.3 to 1.0 across four lines drawn on bare skin, 1.2 across a fringe, 1.7 and more across 48
# lines where hair began.
STEP_MIN = 1.4
# How far to either side of it looks are compared, in ways from chin to brows.
ACROSS = 0.05
# What a face's looks change by at the least: log red/green, blue/green, luminance, roughness.
CHANGE_LEAST = np.array([0.05, 0.04, 0.1, 0.5])
# How far its direction may be from level (cosine), how far out of the face and how low it may lie.
LEVEL, OUTSIDE, LOW = 0.7, -0.15, 0.05
# Pixels that its direction is smoothed by.
SMOOTH_PX = 2.0


def hairline_step(
    hair: np.ndarray, looks: np.ndarray, within: np.ndarray, height: np.ndarray, up: np.ndarray
) -> float:
    """By how much ``looks`` (h, w, 4) change across the border of ``hair`` (h, w) above the brows,
    the median, of what the face's change by over such a way; infinite where there is no border.

    ``within`` (h, w) says how far inside the face a pixel lies and ``height`` (h, w) how far above
    the brows, both in ways of ``up`` (2,) pixels from chin to brows.
    """
    length = float(np.linalg.norm(up))
    across = ACROSS * length
    away = distance_transform_edt(~hair) - distance_transform_edt(hair)
    down, right = np.gradient(gaussian_filter(away, SMOOTH_PX))
    steep = np.hypot(down, right) + 1e-9
    level = -(right * up[0] + down * up[1]) / (steep * length)
    line = (np.abs(away) <= 1) & (level > LEVEL) & (within > OUTSIDE) & (height > LOW)
    face = np.stack(np.nonzero(~hair & (within > 2 * ACROSS)))
    if not line.any() or not face.size:
        return np.inf
    way = across * np.stack([down[line], right[line]]) / steep[line]
    place = np.stack(np.nonzero(line))
    step = _at(looks, place + way) - _at(looks, place - way)
    change = np.abs(_at(looks, face) - _at(looks, face - [[2 * across], [0]]))
    scale = np.maximum(np.median(change, axis=0), CHANGE_LEAST)
    return float(np.median(np.sqrt(np.mean((step / scale) ** 2, axis=1))))


def _at(looks: np.ndarray, places: np.ndarray) -> np.ndarray:
    """(n, 4) of ``looks`` (h, w, 4) at rows and columns (2, n)."""
    layers = np.moveaxis(looks, -1, 0)
    found = [map_coordinates(layer, places, order=1, mode="nearest") for layer in layers]
    return np.stack(found, axis=1)
