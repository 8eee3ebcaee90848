"""Folds of the skin that come with an expression: a photo's albedo has them painted in, and they
fade where the expression does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float

# Each has a strength of its own: below the brows on either side of the head, and above.
PLACES = ("left", "right", "brow")
# Of a result's extra arrays.
PLACE, PULL = "folds_place", "folds_pull"
SLIDERS_MAX = 12  # that pull at the folds of one place
ROUNDING = 1e-4


@dataclass(frozen=True, eq=False)
class Folds:
    """Which folds of a result's map follow which sliders.

    ``place``: how much of each vertex's folds is that of each of PLACES, in all 1 or less; what is
    left stays. ``pull``: what a slider adds to the strength of a place's folds, 0 to 1, which is 1
    in the expression of the photo.
    """

    place: Float[np.ndarray, "vertices places"]
    pull: Float[np.ndarray, "places expressions"]

    def gone(self, expression: Float[np.ndarray, " expressions"]) -> Float[np.ndarray, " vertices"]:
        """The share of the folds that is not there in an ``expression``."""
        missing = 1.0 - np.clip(self.pull @ expression, 0.0, 1.0)
        # In the photo's own expression it is rounding.
        return np.asarray(self.place @ np.where(missing > ROUNDING, missing, 0.0))

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """As a result holds them."""
        return {PLACE: self.place.astype(np.float32), PULL: self.pull.astype(np.float32)}

    @classmethod
    def of(cls, arrays: dict[str, np.ndarray]) -> Folds | None:
        """Those among a result's ``arrays``; None where it has none."""
        if PLACE not in arrays or PULL not in arrays:
            return None
        return cls(arrays[PLACE].astype(np.float64), arrays[PULL].astype(np.float64))
