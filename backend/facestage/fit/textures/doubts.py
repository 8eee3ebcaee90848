"""What of the fitted shading and highlights may be wrong, pixel by pixel, and what of a residual is
pigment all the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.textures.shown import Shown

# How much skin differs from the albedo basis, and beyond how many times the doubt of its shading it
# surely does. Beside a highlight what is too bright is more likely more of it.
PIGMENT_SIGMA, PLAIN_FACTOR, HIGHLIGHT_PLAIN_FACTOR = 0.06, 1.0, 3.0


@dataclass(frozen=True)
class Doubts:
    """What of shading and highlights may be wrong."""

    # Shares of the change over a shift by a landmark's error.
    shading_shift: float = 0.3
    highlight_shift: float = 0.4
    highlight: float = 0.2  # share of the highlight itself


DOUBTS = Doubts()


def in_doubt(
    shown: Shown, body: Float[np.ndarray, " pixels"], doubts: Doubts = DOUBTS
) -> tuple[Float[np.ndarray, " pixels"], Float[np.ndarray, " pixels"]]:
    """Of the logarithm, what of shading and of highlights may be wrong at each pixel; ``body``: the
    radiance that is not gloss.
    """
    gloss, matte = shown.specular.mean(axis=1), shown.diffuse.mean(axis=1)
    shading = doubts.shading_shift * shown.change_over_shift(matte) / np.maximum(matte, 1e-9)
    moved = doubts.highlight_shift * shown.change_over_shift(gloss)
    return shading, np.hypot(doubts.highlight * gloss, moved) / body


def pigment_share(
    brightness: Float[np.ndarray, " pixels"],
    shading: Float[np.ndarray, " pixels"],
    highlight: Float[np.ndarray, " pixels"],
    sigma: Float[np.ndarray, " pixels"] | float = PIGMENT_SIGMA,
) -> Float[np.ndarray, " pixels"]:
    """0..1, how much of a residual of the log albedo is more likely pigment than wrong
    shading.

    What is small may be either; what is many times larger than the doubt of ``shading`` and
    ``highlight`` can only be pigment. ``sigma``: how much pigment varies.
    """
    common = sigma**2 / (sigma**2 + shading**2 + highlight**2)
    factor = np.where(brightness > 0, HIGHLIGHT_PLAIN_FACTOR, PLAIN_FACTOR)
    plain = brightness**2 / (
        brightness**2 + (PLAIN_FACTOR * shading) ** 2 + (factor * highlight) ** 2 + 1e-12
    )
    return np.maximum(common, plain)
