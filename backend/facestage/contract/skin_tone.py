"""Skin color in numbers: CIELAB, and the individual typology angle with its six types.

Chardon, Cretois and Hourseau 1991, "Skin colour typology and suntanning pathways"; the six types
and their limits also in Feng et al. 2022 (FAIR, the benchmark of TRUST). All for D65 and the 2
degree observer, which are white and primaries of Rec. 709.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.errors import InputError

_RGB_TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.0721750],
        [0.0193339, 0.1191920, 0.9503041],
    ]
)
_WHITE = _RGB_TO_XYZ.sum(axis=1)
_CUBE, _LINEAR, _SHIFT = 216.0 / 24389.0, 24389.0 / 27.0 / 116.0, 16.0 / 116.0
# The types from light to dark, with the angle in degrees above which each begins.
SKIN_TYPES = (
    ("very light", 55.0),
    ("light", 41.0),
    ("intermediate", 28.0),
    ("tan", 10.0),
    ("brown", -30.0),
    ("dark", -np.inf),
)
ANGLES = (-80.0, 70.0)  # of all people, in degrees: 40 to 0.8 % melanosomes in the epidermis
# What skin of some angles looks like in linear Rec. 709 RGB, by its pigments
# (models/anatomy/skin.py).
_COLORS = np.array(
    [
        [-79.5, 0.037, 0.015, 0.013],
        [-68.8, 0.067, 0.024, 0.016],
        [-48.1, 0.129, 0.047, 0.025],
        [-26.0, 0.209, 0.089, 0.046],
        [-8.6, 0.274, 0.134, 0.075],
        [10.3, 0.336, 0.186, 0.120],
        [33.9, 0.396, 0.246, 0.184],
        [52.1, 0.437, 0.292, 0.244],
        [67.8, 0.472, 0.336, 0.307],
    ]
)
EXPECTED = (
    f"expected an individual typology angle of {ANGLES[0]:g} (darkest) to {ANGLES[1]:g} degrees "
    "(lightest)"
)


def cielab(color: Float[np.ndarray, " ..."]) -> Float[np.ndarray, " ..."]:
    """L*, a* and b* (..., 3) of reflectances (..., 3) in linear Rec. 709 RGB."""
    relative = np.asarray(color, np.float64) @ _RGB_TO_XYZ.T / _WHITE
    root = np.where(
        relative > _CUBE, np.cbrt(np.maximum(relative, _CUBE)), _LINEAR * relative + _SHIFT
    )
    x, y, z = np.moveaxis(root, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def from_cielab(lab: Float[np.ndarray, " ..."]) -> Float[np.ndarray, " ..."]:
    """The reverse of :func:`cielab`."""
    lightness, a, b = np.moveaxis(np.asarray(lab, np.float64), -1, 0)
    y = (lightness + 16) / 116
    root = np.stack([y + a / 500, y, y - b / 200], axis=-1)
    relative = np.where(root**3 > _CUBE, root**3, (root - _SHIFT) / _LINEAR)
    return np.asarray((relative * _WHITE) @ np.linalg.inv(_RGB_TO_XYZ).T)


def typology_angle(color: Float[np.ndarray, " ..."]) -> Float[np.ndarray, " ..."]:
    """The individual typology angle, ITA, in degrees (...) of reflectances (..., 3): how light."""
    lab = cielab(color)
    return np.asarray(np.degrees(np.arctan2(lab[..., 0] - 50.0, lab[..., 2])))


def skin_type(angle: float) -> str:
    """The type of an ITA in degrees."""
    return next(name for name, above in SKIN_TYPES if angle > above)


def type_angle(name: str) -> float:
    """The middle of the angles in degrees of a skin type. Raises KeyError."""
    limits = [ANGLES[1], *(max(above, ANGLES[0]) for _, above in SKIN_TYPES)]
    lighter = dict(zip((name for name, _ in SKIN_TYPES), limits, strict=False))
    return (lighter[name] + max(dict(SKIN_TYPES)[name], ANGLES[0])) / 2


def usual_color(angle: float) -> tuple[float, float, float]:
    """What skin of a typology ``angle`` in degrees usually looks like, linear Rec. 709 RGB."""
    angles, *channels = _COLORS.T
    red, green, blue = (float(np.interp(angle, angles, channel)) for channel in channels)
    return red, green, blue


def check_skin_tone(angle: float) -> None:
    """Raise InputError where no skin has this typology ``angle`` in degrees."""
    if not ANGLES[0] <= angle <= ANGLES[1]:
        raise InputError(f"The skin tone is {angle:g}; {EXPECTED}.")


def parse_skin_tone(text: str) -> float:
    """The typology angle in degrees that a skin type or a number says. Raises InputError."""
    name = text.strip().lower().replace("-", " ").replace("_", " ")
    if name in dict(SKIN_TYPES):
        return type_angle(name)
    try:
        angle = float(text)
    except ValueError:
        types = ", ".join(name.replace(" ", "-") for name, _ in SKIN_TYPES)
        raise InputError(f"The skin tone is '{text}'; {EXPECTED}, or one of {types}.") from None
    check_skin_tone(angle)
    return angle


def chromaticity(color: Float[np.ndarray, " ..."]) -> Float[np.ndarray, " ..."]:
    """The shares (..., 3) of red, green and blue in a color (..., 3)."""
    total = np.asarray(color, np.float64).sum(axis=-1, keepdims=True)
    return np.asarray(color / np.maximum(total, 1e-12))
