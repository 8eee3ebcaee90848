"""What the model looks like at one state, beside the photo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.fit.energy.shadow_edges import Penumbra
from facestage.fit.face.state import State
from facestage.fit.forward.shading import Image

# The weight from which a pixel is the face's rather than not: hair and cloth count less.
COUNTED_MIN = 0.5


@dataclass(frozen=True)
class Evaluation:
    """The model's answer at one state, and how it compares to the photo."""

    state: State
    image: Image
    residual: Float[np.ndarray, "height width 3"]  # model minus photo, 0 where unused
    # the model's specular radiance, mean of the channels
    highlight: Float[np.ndarray, "height width 1"]
    base_weight: Float[np.ndarray, "height width"]  # 0..1 before robust weighting
    seed: int
    penumbra: Penumbra | None = None  # found where the motion of shadows counts

    @property
    def counted(self) -> Bool[np.ndarray, "height width"]:
        """The pixels that the fit is judged by: the face's own."""
        return np.asarray(self.base_weight > COUNTED_MIN)

    @property
    def rms(self) -> float | None:
        """Root mean square of the residual over the pixels that count; None where none does."""
        used = self.residual[self.counted]
        return float(np.sqrt((used**2).mean())) if used.size else None
