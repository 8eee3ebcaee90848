"""The color of the light, read from what is grey in a photo: what photographers' grey cards are
for.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.contract.camera import SIDE_MAX
from facestage.contract.errors import InputError
from facestage.contract.light_stage import RADIANCE_MAX

RADIUS = 2  # pixels beside the chosen one, in every direction: one alone is noise
# Linear. Where a photo is darker, noise, flare and rounding have the color, not the light.
DARK = 0.01
# The brightest code value of a display image, less rounding: there the sensor, or the file, ran
# out.
CLIP_LEVEL = 0.996
ELSEWHERE = "choose something grey that is neither black nor saturated"


def check_white_balance(values: tuple[float, ...]) -> None:
    """Raise InputError where ``values`` are neither a pixel nor a color."""
    pixel = len(values) == 2 and all(0 <= value <= SIDE_MAX for value in values)
    color = len(values) == 3 and all(0 < value <= RADIANCE_MAX for value in values)
    if not pixel and not color:
        shown = ",".join(f"{value:g}" for value in values)
        raise InputError(
            f"The white balance is {shown}; expected X,Y, a pixel of something grey in the photo, "
            "or R,G,B, the linear color that it shows, each greater than 0."
        )


def color_of_grey(
    color: Float[np.ndarray, "height width 3"],
    usable: Bool[np.ndarray, "height width"],
    clipped: Bool[np.ndarray, "height width 3"],
    x: float,
    y: float,
) -> Float[np.ndarray, " 3"]:
    """What the linear ``color`` of a photo is around pixel (``x``, ``y``), counted from its upper
    left corner.

    Raises InputError where a pixel there is outside, not ``usable``, ``clipped`` or black.
    """
    height, width = usable.shape
    if not (0 <= x < width and 0 <= y < height):
        raise InputError(
            f"The white balance is to be read at ({x:g}, {y:g}), which is outside the photo of "
            f"{width} x {height} pixels; {ELSEWHERE}."
        )
    around = tuple(slice(max(int(at) - RADIUS, 0), int(at) + RADIUS + 1) for at in (y, x))
    where = f"The photo at ({int(x)}, {int(y)}), where the white balance is to be read, is"
    if not usable[around].all():
        raise InputError(f"{where} transparent or not finite; {ELSEWHERE}.")
    if clipped[around].any():
        raise InputError(f"{where} saturated, which has no color; {ELSEWHERE}.")
    found = np.asarray(color[around].reshape(-1, 3).mean(axis=0), np.float64)
    if found.min() < DARK:
        raise InputError(f"{where} black in some channel, which has no color; {ELSEWHERE}.")
    return found
