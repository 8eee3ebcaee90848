"""Whether there are wrinkles in a height that comes with an expression, and where.

A wrinkle is a valley: narrow, and longer than wide. What shading and tracking are wrong by makes
ridges as deep as valleys, so that the deepest ridge says how deep a valley may be for nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter

from facestage.contract.arrays import Bool, Float, Float32
from facestage.fit.sequence.wrinkles.alignment import blurred
from facestage.images.opencv import opencv

# Of what is looked for, standard deviations in mm: across and along a valley; and of the valley
# whose depth is the measure.
ACROSS, ALONG, VALLEY = 0.9, 4.0, 1.0
DIRECTIONS = 12
APART = 5.0  # mm between places that are told apart
BORDER = 2.5  # mm from what is not seen
# Found is what is deeper than the deepest ridge so many times, and than so many mm. Of two films
# with wrinkles and their like without any: docs/sequences.md.
CLEAR, FLOOR = 2.5, 0.1
# Kept is what is deeper than the deepest ridge so many times, and what lies beside it (mm).
KEPT, BESIDE, SOFT = 1.3, 2.5, 0.8


@dataclass(frozen=True, eq=False)
class Folds:
    """Valleys of one height."""

    height: Float32[np.ndarray, "rows columns"]  # mm, 0 but where they are
    depth: float  # mm, of the deepest
    noise: float  # mm, of the deepest ridge

    @property
    def are_clear(self) -> bool:
        """Whether there are more than errors make."""
        return self.depth > max(CLEAR * self.noise, FLOOR)


def folds_of(
    height: Float[np.ndarray, "rows columns"],
    inside: Bool[np.ndarray, "rows columns"],
    spacing: float,
) -> Folds:
    """Those ``inside``; ``spacing``: mm between texels."""
    cv2 = opencv()
    values = np.ascontiguousarray(height, np.float32)
    signed = np.zeros_like(values)
    for kernel in _kernels(spacing):
        found = cv2.filter2D(values, -1, kernel, borderType=cv2.BORDER_REPLICATE)
        signed = np.where(np.abs(found) > np.abs(signed), found, signed)
    side = 2 * round(BORDER / spacing) + 1
    inner = cv2.erode(inside.astype(np.uint8), np.ones((side, side), np.uint8)) > 0
    signed = np.where(inner, signed, 0.0)
    size = np.abs(signed)
    peaks = (size == maximum_filter(size, 2 * round(APART / spacing) + 1)) & (size > 0)
    depth = float(signed[peaks].max(initial=0.0))
    noise = float(-signed[peaks].min(initial=0.0))
    kept = (signed > KEPT * noise).astype(np.uint8)
    reach = 2 * round(BESIDE / spacing) + 1
    round_ = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    share = blurred(cv2.dilate(kept, round_), SOFT / spacing)
    return Folds((values * share).astype(np.float32), depth, noise)


def _kernels(spacing: float) -> Iterator[Float32[np.ndarray, "side side"]]:
    """What measures a valley's depth, for valleys of all directions."""
    across, along, valley = ACROSS / spacing, ALONG / spacing, VALLEY / spacing
    half = int(3 * along)
    y, x = np.mgrid[-half : half + 1, -half : half + 1]
    for turn in np.arange(DIRECTIONS) * np.pi / DIRECTIONS:
        u, v = x * np.cos(turn) + y * np.sin(turn), -x * np.sin(turn) + y * np.cos(turn)
        bell = np.exp(-0.5 * ((u / along) ** 2 + (v / across) ** 2))
        kernel = (v**2 / across**2 - 1) * bell
        kernel -= bell * (kernel.sum() / bell.sum())  # what is even has no depth
        yield (kernel / -(kernel * np.exp(-0.5 * (v / valley) ** 2)).sum()).astype(np.float32)
