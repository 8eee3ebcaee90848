"""Skin color in numbers: CIELAB, and the individual typology angle with its six types.

Chardon, Cretois and Hourseau 1991, "Skin colour typology and suntanning pathways"; the six types
and their limits also in Feng et al. 2022 (FAIR, the benchmark of TRUST). All for D65 and the 2
degree observer, which are white and primaries of Rec. 709.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float

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


def chromaticity(color: Float[np.ndarray, " ..."]) -> Float[np.ndarray, " ..."]:
    """The shares (..., 3) of red, green and blue in a color (..., 3)."""
    total = np.asarray(color, np.float64).sum(axis=-1, keepdims=True)
    return np.asarray(color / np.maximum(total, 1e-12))
