"""A front view of the built-in head's mean face, and the landmarks of any state of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.landmark_term import landmark_pixels
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.models.registry import load_model
from reference.front_view import front_view

SCHEME = "mediapipe478"


@dataclass(frozen=True)
class LandmarkedFace:
    """The mean face of the built-in head before a camera."""

    geometry: FaceGeometry
    state: State

    def with_weights(self, **weights: float) -> State:
        """The face with these expressions."""
        names = self.geometry.model.expression_names
        return replace(self.state, expression=np.array([weights.get(n, 0.0) for n in names]))

    def landmarks(self, state: State) -> Landmarks:
        """All points where they are at ``state``."""
        blank = Landmarks(SCHEME, np.zeros((478, 2)), np.ones(478, bool))
        return replace(blank, points=landmark_pixels(self.geometry, blank, state))


@cache
def landmarked_face() -> LandmarkedFace:
    """The built-in head, expressionless."""
    model = load_model("default")
    return LandmarkedFace(FaceGeometry(model), front_view(model))
