"""Each vertex's standard deviation as one number and as a color: the report's picture and Blender's
attribute have the same scale.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float, Integer, Num

DEVIATION = "vertex_deviation_mm"  # of a result's extra arrays
# The scale ends where nearly all of the face lies below; the neck and the back of the head are
# beyond.
FACE = "narrow_face"  # the region of the face model
LIMIT_PERCENTILE, LEAST_LIMIT_MM, MOST_MM = 97, 0.1, 1e9
# Perceptually uniform, and readable without color vision. As sRGB codes, every fifteenth of its 256
# (Smith and van der Walt, matplotlib, CC0).
COLOR_MAP = "viridis"
CODES = (
    "440154 481769 472a7a 433d84 3d4e8a 355e8d 2e6d8e 297b8e 23898e "
    "1f978b 21a585 2eb37c 46c06f 65cb5e 89d548 b0dd2f d8e219 fde725"
)


def finite_mm(deviation: Num[np.ndarray, "vertices 3"]) -> Float[np.ndarray, "vertices 3"]:
    """Standard deviations in mm as they are shown: 0 where nothing holds the vertex."""
    return np.clip(np.nan_to_num(np.asarray(deviation, np.float64), posinf=0.0), 0.0, MOST_MM)


def scale_end(total: Float[np.ndarray, " vertices"], face: Integer[np.ndarray, " _"]) -> float:
    """Where the color scale of deviations ``total`` in mm ends, by the face's vertices."""
    values = total[face]
    nearly_all = float(np.percentile(values, LIMIT_PERCENTILE)) if values.size else 0.0
    return nice_limit(nearly_all, LEAST_LIMIT_MM)


def nice_limit(value: float, least: float) -> float:
    """The smallest 1, 2 or 5 times a power of ten that is not below ``value``, and at least
    ``least``.
    """
    limit = least
    steps = (2.0, 2.5, 2.0)  # 1 -> 2 -> 5 -> 10
    index = 0
    while limit < value * (1 - 1e-9) and limit < 1e9:
        limit *= steps[index % 3]
        index += 1
    return float(f"{limit:.6g}")


def colors(shares: Float[np.ndarray, " values"]) -> Float[np.ndarray, "values 3"]:
    """sRGB colors, 0 to 1, of values as shares of the scale; beyond its ends those of the ends."""
    codes = np.array(list(bytes.fromhex(CODES))).reshape(-1, 3) / 255.0
    places = np.linspace(0.0, 1.0, len(codes))
    return np.stack([np.interp(shares, places, channel) for channel in codes.T], axis=1)
