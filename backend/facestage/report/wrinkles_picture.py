"""The wrinkles of a film, as a lamp from the side would show them on flat skin."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from facestage.contract.arrays import Float, UInt8
from facestage.contract.files.atomic import atomic_file
from facestage.report.figure import DARK, Canvas

SIDE, GAP = 300.0, 14.0
# What of grey a slope of 1 is, and how much of the slope to the right and downwards counts.
CONTRAST, LAMP = 0.6, (0.7, 0.7)
MARGIN = 0.05  # of the shown part's side, around it


def write_wrinkles_picture(
    path: Path, heights: Mapping[str, Float[np.ndarray, "size size"]], texel_mm: float
) -> None:
    """Height maps (mm) by the words above them; ``texel_mm``: between their texels, about."""
    box = _box(np.any([height != 0 for height in heights.values()], axis=0))
    canvas = Canvas(GAP + len(heights) * (SIDE + GAP), SIDE + 40, DARK)
    for place, (words, height) in enumerate(heights.items()):
        left = GAP + place * (SIDE + GAP)
        canvas.text(left, 20, words, 10, weight="bold")
        canvas.picture(left, 28, SIDE, SIDE, shaded(height[box], texel_mm))
    with atomic_file(path) as temporary:
        canvas.save(temporary)


def shaded(
    height: Float[np.ndarray, "rows columns"], texel_mm: float
) -> UInt8[np.ndarray, "rows columns 3"]:
    """Grey, lighter where it faces a lamp at the upper left."""
    down, right = np.gradient(height.astype(np.float64), texel_mm)
    grey = 0.5 + CONTRAST * (LAMP[0] * right + LAMP[1] * down)
    return np.repeat(np.round(255 * np.clip(grey, 0, 1)).astype(np.uint8)[..., None], 3, axis=2)


def _box(shown: np.ndarray) -> tuple[slice, slice]:
    """Rows and columns of a square around what is shown."""
    if not shown.any():
        return slice(None), slice(None)
    low, high = np.argwhere(shown).min(axis=0), np.argwhere(shown).max(axis=0)
    half = 0.5 * float((high - low).max()) * (1 + 2 * MARGIN) + 1
    first = np.clip(np.round(0.5 * (low + high) - half), 0, None).astype(int)
    rows, columns = (slice(int(start), int(start + 2 * half)) for start in first)
    return rows, columns
