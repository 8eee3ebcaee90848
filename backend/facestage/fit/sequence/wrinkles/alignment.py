"""Frames laid onto each other: tracking is off by a millimetre, and so is every mole.

What tracking is off by comes with the expression, as wrinkles do. It moves the skin's texture, and
smoothly: each frame's sheet is moved by a smooth displacement d so that it shows what the frames
show in which the face is at rest, by robust steps of least squares over windows (Lucas and Kanade
1981), wide ones first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from facestage.contract.arrays import Float, Float32
from facestage.fit.sequence.wrinkles.sheets import Sheet
from facestage.fit.textures.relief_maps.relief_evidence import difference
from facestage.images.opencv import opencv

# Of the windows and of what is compared, one standard deviation in mm; wide ones first.
WINDOWS, FINEST = (12.0, 8.0, 5.0), (1.5, 1.0, 0.7)
STEPS = 4
# What a displacement is held to 0 by: as much as a texture of this root mean square slope in log
# radiance per mm would hold it in place.
HOLD = 0.005
FARTHEST = 4.0  # mm
COUNTS_MAX = 400.0  # inverse variance, that of the usual noise
ROBUST = 0.08  # log radiance by which a fold, or a shadow, is no matter of place
AT_REST = 0.35  # strength, of the most that a group has, from which on a frame counts little
# Texels of a coarser lattice that a Gaussian's standard deviation has at least.
COARSE = 4.0
# How far frames are still off, mm: what a texture changes over that is not told from wrinkles.
LEFT = 0.35


def at_rest(
    sheets: Sequence[Sheet], strength: Float[np.ndarray, "groups frames"]
) -> Float32[np.ndarray, "rows columns"]:
    """What sheets show without the expressions."""
    low = strength.min(axis=1, keepdims=True)
    share = (strength - low) / np.maximum(strength.max(axis=1, keepdims=True) - low, 1e-9)
    rest = np.exp(-((share.max(axis=0) / AT_REST) ** 2)) + 1e-3
    weights = [own * sheet.weight for own, sheet in zip(rest, sheets, strict=True)]
    total = sum(weight * sheet.value for weight, sheet in zip(weights, sheets, strict=True))
    return np.asarray(total / np.maximum(sum(weights), 1e-6), np.float32)


def aligned(
    sheets: Sequence[Sheet], strength: Float[np.ndarray, "groups frames"], spacing: float
) -> list[Sheet]:
    """The sheets moved onto what they show at rest; ``spacing``: mm between texels. Where that
    changes fast, they count for less.
    """
    moves = [np.zeros((2, *sheets[0].value.shape), np.float32) for _ in sheets]
    result = list(sheets)
    for window, finest in zip(WINDOWS, FINEST, strict=True):
        rest = at_rest(result, strength)
        for number, sheet in enumerate(sheets):
            moves[number] = displacement(
                sheet, rest, moves[number], window / spacing, finest / spacing, spacing
            )
            result[number] = moved(sheet, moves[number])
    rest = blurred(at_rest(result, strength), FINEST[-1] / spacing)
    slope = sum(difference(rest, axis) ** 2 for axis in (0, 1))
    doubt = (LEFT / spacing) ** 2 * slope
    return [replace(one, weight=one.weight / (1.0 + one.weight * doubt)) for one in result]


def displacement(
    sheet: Sheet,
    rest: Float32[np.ndarray, "rows columns"],
    start: Float32[np.ndarray, "2 rows columns"],
    window: float,
    finest: float,
    spacing: float,
) -> Float32[np.ndarray, "2 rows columns"]:
    """By how many texels, down and to the right, the sheet lies off the face at ``rest``.
    ``window``, ``finest``: texels.
    """
    target = blurred(rest, finest)
    slope = np.stack([difference(target, axis) for axis in (0, 1)])
    found, smooth = start, replace(sheet, value=blurred(sheet.value, finest))
    hold = (HOLD * spacing) ** 2
    for _ in range(STEPS):
        now = moved(smooth, found)
        off = now.value - target
        weight = np.minimum(now.weight / COUNTS_MAX, 1.0) / (1.0 + (off / ROBUST) ** 2)
        a, b, c = (
            blurred(weight * slope[i] * slope[j], window) for i, j in ((0, 0), (0, 1), (1, 1))
        )
        p, q = (blurred(weight * off * slope[i], window) for i in (0, 1))
        a, c = a + hold, c + hold
        step = -np.stack([c * p - b * q, a * q - b * p]) / (a * c - b * b)
        found = found + step
        length = np.linalg.norm(found, axis=0) * spacing
        found = (found * np.minimum(1.0, FARTHEST / np.maximum(length, 1e-9))).astype(np.float32)
    return found


def moved(sheet: Sheet, by: Float32[np.ndarray, "2 rows columns"]) -> Sheet:
    """The sheet as it is ``by`` so many texels away; its slopes vary slowly, and stay."""
    down, right = (np.indices(sheet.value.shape) + by).astype(np.float32)
    cv2 = opencv()
    value, weight = (
        cv2.remap(each, right, down, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        for each in (sheet.value, sheet.weight)
    )
    return replace(sheet, value=value, weight=weight)


def blurred(
    values: Float[np.ndarray, "rows columns"], width: float
) -> Float32[np.ndarray, "rows columns"]:
    """By a Gaussian of so many texels; by a wide one on a coarser lattice, in a tenth of the time
    and to a hundredth of the values' range.
    """
    cv2, fine = opencv(), np.ascontiguousarray(values, np.float32)
    times = int(width / COARSE)
    if times < 3:
        return np.asarray(cv2.GaussianBlur(fine, (0, 0), width))
    rows, columns = fine.shape
    beyond = 0, -rows % times, 0, -columns % times
    whole = cv2.copyMakeBorder(fine, *beyond, cv2.BORDER_REFLECT_101)
    high, wide = whole.shape
    means = cv2.resize(whole, (wide // times, high // times), interpolation=cv2.INTER_AREA)
    coarse = cv2.GaussianBlur(means, (0, 0), width / times)
    found = cv2.resize(coarse, (wide, high), interpolation=cv2.INTER_LINEAR)
    return np.asarray(found[:rows, :columns])
