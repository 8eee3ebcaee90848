"""Linear color to the screen's, one exposure for all pictures of a photo, and shrinking."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from facestage.contract.files.color import REC709, linear_to_srgb

if TYPE_CHECKING:
    from PIL.Image import Image

MAX_SIDE = 1024  # pixels of the longer side of any picture of the photo or a texture
# A photo whose highlights (99th percentile) lie in this range is shown as it is.
HIGHLIGHTS = (0.1, 1.25)
_HIGHLIGHT_SAMPLES = 100_000
_BRIGHTEST = 65504.0  # stands for infinity where pixels are averaged


def to_srgb8(linear: np.ndarray) -> np.ndarray:
    """uint8 sRGB code values of linear values, any shape; IEC 61966-2-1, encoding.

    Values are clipped to 0..1; NaN becomes 0. Within 0.03 code values of the exact curve before
    rounding.
    """
    # fmax and fmin prefer the number to NaN.
    values = np.fmin(np.fmax(np.asarray(linear, np.float32), 0.0), 1.0)
    return _srgb_table()[(values * 65535.0 + 0.5).astype(np.uint16)]


@cache
def _srgb_table() -> np.ndarray:
    """(65536,) uint8: a look-up is ten times faster than the power."""
    linear = np.arange(65536) / 65535.0
    return np.round(255.0 * linear_to_srgb(linear)).astype(np.uint8)


def luminance(linear: np.ndarray) -> np.ndarray:
    """(...) Rec. 709 luminance of (..., 3) linear RGB."""
    return linear @ np.array(REC709, np.float32)


def exposure(photo: np.ndarray) -> float:
    """The factor that the photo and every render of it are multiplied with before they are encoded.

    1 for a display-referred photo. Only a scene-referred one, whose 99th percentile over all
    channels lies outside HIGHLIGHTS, is scaled so that this percentile becomes 1. ``photo`` (h, w,
    3) linear.
    """
    values = np.asarray(photo).reshape(-1)
    values = values[:: max(1, values.size // _HIGHLIGHT_SAMPLES)]
    values = values[np.isfinite(values)]
    highlight = float(np.percentile(values, 99)) if values.size else 0.0
    if highlight <= 0.0 or HIGHLIGHTS[0] <= highlight <= HIGHLIGHTS[1]:
        return 1.0
    return 1.0 / highlight


def clean(linear: np.ndarray) -> np.ndarray:
    """float32 copy with NaN and negative values 0 and infinity very bright."""
    return np.fmin(np.fmax(np.asarray(linear, np.float32), 0.0), _BRIGHTEST)


def shrink_factor(size: tuple[int, ...], side: int = MAX_SIDE) -> float:
    """How much :func:`shrink` scales an image of ``size`` (height, width): at most 1."""
    return min(1.0, side / max(size[:2]))


def shrink(linear: np.ndarray, side: int = MAX_SIDE) -> np.ndarray:
    """(h, w) or (h, w, 3) float32, area-averaged until the longer side is at most ``side``
    pixels.
    """
    factor = shrink_factor(linear.shape, side)
    if factor == 1.0:
        return clean(linear)
    height, width = (max(1, round(length * factor)) for length in linear.shape[:2])
    from PIL import Image

    def resized(channel: np.ndarray) -> np.ndarray:
        picture: Image.Image = Image.fromarray(np.ascontiguousarray(clean(channel)))
        return np.asarray(picture.resize((width, height), Image.Resampling.BOX))

    if linear.ndim == 2:
        return resized(linear)
    return np.stack([resized(linear[..., channel]) for channel in range(linear.shape[2])], axis=-1)


def to_image(linear: np.ndarray) -> Image:
    """The picture as Pillow has it, from (h, w) or (h, w, 3) linear values."""
    from PIL import Image

    return Image.fromarray(to_srgb8(linear))
