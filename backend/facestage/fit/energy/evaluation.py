"""What the model looks like at one state, beside the photo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.fit.energy.shadow_edges import Penumbra
from facestage.fit.face.state import State
from facestage.fit.forward.shading import Image


@dataclass(frozen=True)
class Evaluation:
    """The model's answer at one state, and how it compares to the photo."""

    state: State
    image: Image
    residual: np.ndarray  # (h, w, 3) model minus photo, 0 where unused
    highlight: np.ndarray  # (h, w, 1) the model's specular radiance, mean of the channels
    base_weight: np.ndarray  # (h, w) 0..1 before robust weighting
    seed: int
    penumbra: Penumbra | None = None  # found where the motion of shadows counts
