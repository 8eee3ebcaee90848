"""The color of all light together where something grey in the photo shows it.

A grey card beside the face stands in the same light, but sees another mix of it: turned towards the
window it is bluer than the face, towards the bulb redder. Which way what is grey in a photo faces,
nobody says; only that the camera sees it. So it may face any way towards the camera, and as much as
its color would change with that under the lights as they are found to be, its color is in doubt: by
nothing where all lights are of one color.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.face.light_axes import color_of

# What is called grey, along and across the locus of lamps and skies: cards are within 0.01, white
# paper, walls and shirts, bluish by brighteners or yellowed, several times that.
GREY_SIGMA = np.array([0.03, 0.02])
FACINGS = 128
DARK_SHARE = 1e-3  # of the mean light on it, below which nobody would take it for grey


@dataclass(frozen=True, eq=False)
class WhiteBalance:
    """What the photo's grey says of the light, as a phase begins; see ``light_color``."""

    color: Float[np.ndarray, " 2"]  # along and across the locus, of channels over their mean
    sigma: Float[np.ndarray, " 2"]
    shares: Float[np.ndarray, " lights"]  # how much of each light grey sees on average, mean 1

    @classmethod
    def of(
        cls,
        grey: Float[np.ndarray, " 3"],
        towards: Float[np.ndarray, "lights 3"],
        flux: Float[np.ndarray, " lights"],
        radiance: Float[np.ndarray, "lights 3"],
        camera: Float[np.ndarray, " 3"],
    ) -> Self:
        """Of what is ``grey`` (linear, any brightness) under lights of this ``radiance`` in the
        directions ``towards`` them, of ``flux`` for each radiance; ``camera``: direction to it.
        """
        facings = _facings()
        often = np.maximum(facings @ camera, 0.0)  # as many pixels as it shows the camera
        seen = np.maximum(facings @ towards.T, 0.0) * flux  # (facings, lights)
        shares = often @ seen
        shares = shares * len(shares) / max(float(shares.sum()), 1e-30)
        mixes = seen @ radiance
        often = np.where(mixes.mean(axis=1) > DARK_SHARE * mixes.mean(), often, 0.0)
        spread = np.zeros(2)
        if often.any() and mixes.any():
            colors = color_of(np.maximum(mixes, 1e-30))
            spread = np.sqrt(_mean((colors - _mean(colors, often)) ** 2, often))
        return cls(color_of(grey), np.hypot(GREY_SIGMA, spread), shares)


def _mean(
    values: Float[np.ndarray, "facings 2"], often: Float[np.ndarray, " facings"]
) -> Float[np.ndarray, " 2"]:
    return np.asarray(often @ values / often.sum())


def _facings() -> Float[np.ndarray, "facings 3"]:
    """Directions all around, as dense everywhere."""
    index = np.arange(FACINGS) + 0.5
    height, turn = 1.0 - 2.0 * index / FACINGS, np.pi * (1.0 + np.sqrt(5.0)) * index
    around = np.sqrt(1.0 - height**2)
    return np.stack([around * np.cos(turn), around * np.sin(turn), height], axis=1)
