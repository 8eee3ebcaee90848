"""What a photo's EXIF says of the focal length, in pixels, and how far to believe it.

``FocalLengthIn35mmFilm`` is the lens that shows as much along the diagonal of 36 x 24 mm (CIPA
DCG-001), so focal_px = f35 * diagonal_px / 43.27; some makers mean the width, which for a sensor of
4:3 is 4 % less.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

EXIF_IFD = 0x8769
FOCAL_LENGTH, FOCAL_35MM, ZOOM = 0x920A, 0xA405, 0xA404
WIDTH, HEIGHT = 0xA002, 0xA003  # PixelXDimension, PixelYDimension: of the picture as it was taken
PLANE_X, PLANE_UNIT = 0xA20E, 0xA210
UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0, 5: 0.001}
FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
# Standard deviations of log focal: f35 is rounded to a millimetre and its convention is not sure; a
# sensor's size is; nothing says what size the picture had; it was cropped.
SIGMA_35MM, SIGMA_SENSOR, SIGMA_UNVERIFIED, SIGMA_CROPPED = 0.05, 0.03, 0.10, 0.20
# of sensors, and of what cameras make of them
ASPECTS, ASPECT_TOLERANCE = (3 / 2, 4 / 3, 16 / 9), 0.015
FOCAL_35MM_RANGE = (8.0, 1500.0)  # mm, of lenses that exist


@dataclass(frozen=True)
class FocalPrior:
    """What is known of a lens before the fit."""

    focal_px: float
    log_sigma: float  # standard deviation of log(focal)
    source: str  # a clause that says where it comes from


def focal_prior(exif: Any, width: int, height: int) -> FocalPrior | None:
    """The focal length that Pillow's ``exif`` gives for a picture stored with ``width`` x
    ``height`` pixels.

    None where it says nothing that can be used. Never raises: what is no number is as good as
    missing.
    """
    try:
        tags = exif.get_ifd(EXIF_IFD)
    except (
        LookupError,
        ValueError,
        TypeError,
        SyntaxError,
        OSError,
        ArithmeticError,
        struct.error,
    ):
        return None
    return _from_sensor(tags, width, height) or _from_35mm(tags, width, height)


def _from_sensor(tags: Mapping[int, Any], width: int, height: int) -> FocalPrior | None:
    """From the focal length in mm and the pixels per mm of the sensor; only of a picture in its
    first size.

    A crop keeps the pixels per mm; whether a smaller picture was cropped or resized cannot be told.
    """
    focal, density, unit = (
        _number(tags, FOCAL_LENGTH),
        _number(tags, PLANE_X),
        UNIT_MM.get(tags.get(PLANE_UNIT, 2)),
    )
    own = _own_size(tags)
    if focal is None or density is None or unit is None or own is None:
        return None
    # Some cameras give the density of the whole sensor beside a smaller picture: then the sensor
    # has an odd size.
    sensor_mm = max(own) / density * unit
    if sorted(own) != sorted((width, height)) or not 4.0 <= sensor_mm <= 70.0 or _zoom(tags) > 1:
        return None
    pixels = focal * density / unit
    return (
        FocalPrior(pixels, SIGMA_SENSOR, f"EXIF: {focal:g} mm on a sensor of {sensor_mm:.1f} mm")
        if _plausible(pixels, width, height)
        else None
    )


def _from_35mm(tags: Mapping[int, Any], width: int, height: int) -> FocalPrior | None:
    equivalent = _number(tags, FOCAL_35MM)
    if equivalent is None or not FOCAL_35MM_RANGE[0] <= equivalent <= FOCAL_35MM_RANGE[1]:
        return None
    per_pixel, own, words = (
        equivalent / FILM_DIAGONAL_MM,
        _own_size(tags),
        f"EXIF: {equivalent:g} mm of 35 mm film",
    )
    diagonal, sigma = math.hypot(width, height), SIGMA_35MM
    if own is None:
        sigma, words = SIGMA_UNVERIFIED, f"{words}, not known for which size"
    elif abs(_aspect(*own) / _aspect(width, height) - 1) > ASPECT_TOLERANCE or not _whole(
        width, height
    ):
        # A part of the picture shows less than the lens did: between as many pixels per angle as
        # before (cut only) and as few as the largest part of that shape would have (cut, then
        # resized).
        most = (
            math.hypot(*own)
            if sorted(own) != sorted((width, height))
            else _enclosing(width, height)
        )
        scale = max(max(width, height) / max(own), min(width, height) / min(own))
        least = most * min(scale, 1.0) if sorted(own) != sorted((width, height)) else diagonal
        diagonal = math.sqrt(most * least)
        sigma = max(SIGMA_CROPPED, 0.5 * math.log(most / least))
        words = f"{words}; the picture seems to be a part of what was taken"
    zoom = _zoom(tags)
    if zoom > 1:
        # Some makers multiply the lens by the digital zoom, some do not.
        diagonal *= math.sqrt(zoom)
        sigma, words = (
            math.hypot(sigma, 0.5 * math.log(zoom)),
            f"{words}; with digital zoom {zoom:g}",
        )
    return FocalPrior(per_pixel * diagonal, sigma, words)


def _own_size(tags: Mapping[int, Any]) -> tuple[float, float] | None:
    width, height = _number(tags, WIDTH), _number(tags, HEIGHT)
    return None if width is None or height is None else (width, height)


def _zoom(tags: Mapping[int, Any]) -> float:
    return min(_number(tags, ZOOM) or 1.0, 100.0)


def _aspect(width: float, height: float) -> float:
    return max(width, height) / min(width, height)


def _whole(width: int, height: int) -> bool:
    """Whether a picture has the shape of a sensor.

    An editor that crops writes the new size into the EXIF.
    """
    return any(abs(_aspect(width, height) / aspect - 1) < ASPECT_TOLERANCE for aspect in ASPECTS)


def _enclosing(width: int, height: int) -> float:
    """Diagonal of the smallest 4:3 picture, upright or not, that contains ``width`` x
    ``height``.
    """
    long, short = max(width, height), min(width, height)
    sides = (
        (max(long, short * 4 / 3), max(short, long * 3 / 4)),
        (max(short, long * 4 / 3), max(long, short * 3 / 4)),
    )
    return min(math.hypot(*pair) for pair in sides)


def _plausible(focal_px: float, width: int, height: int) -> bool:
    equivalent = focal_px * FILM_DIAGONAL_MM / math.hypot(width, height)
    return FOCAL_35MM_RANGE[0] <= equivalent <= FOCAL_35MM_RANGE[1]


def _number(tags: Mapping[int, Any], tag: int) -> float | None:
    """A positive finite number, or None."""
    try:
        value = float(tags[tag])
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        return None
    return value if math.isfinite(value) and value > 0 else None
