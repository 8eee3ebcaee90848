"""A front view of the built-in head's mean face, and the landmarks of any state of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from facestage.contract.job import Weights
from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.landmark_term import LANDMARK_SIGMA_SHARE, LandmarkTerm, landmark_pixels
from facestage.fit.energy.pair_distances import PairDistances
from facestage.fit.energy.priors import Priors
from facestage.fit.energy.term import Term
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHAPE, Known
from facestage.fit.given.face_areas import face_size_px
from facestage.fit.stages.photo_descent import PhotoDescent
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

    def found(self, state: State, random: np.random.Generator) -> Landmarks:
        """All points as a detector has them. Neighbors err together: the whole face by more than a
        lid, an iris or a side against the other.
        """
        true = self.landmarks(state)
        noise = random.normal(size=2) + 0.2 * random.normal(size=(478, 2))
        sigma = LANDMARK_SIGMA_SHARE * face_size_px(true)
        return replace(true, points=true.points + sigma * noise)

    def landmark_stage(self, landmarks: Landmarks, *terms: Term, **known: Any) -> State:
        """Where priors, points and ``terms`` take the face, with what else is ``known``."""
        layout = Layout(self.state)
        all_known = Known(
            LightParameters(np.zeros(1, bool), np.ones((1, 3)), False),
            self.state.camera.focal_px,
            expression_box=self.geometry.model.expression_box,
            **known,
        )
        low, high = layout.bounds(all_known)
        sigma = LANDMARK_SIGMA_SHARE * face_size_px(landmarks)
        points = LandmarkTerm(self.geometry, landmarks, sigma)
        energy = Energy(layout, (Priors(layout, all_known, Weights()), points, *terms))
        state = self.state
        for blocks in (("pose",), SHAPE):
            held = ~layout.mask(blocks) | layout.mask(("focal",))
            stage = PhotoDescent("landmarks", blocks, energy, 30, held, low, high)
            for step in stage.run(state, 0, np.inf):
                state = step.state
        return state


@cache
def landmarked_face() -> LandmarkedFace:
    """The built-in head, expressionless."""
    model = load_model("default")
    return LandmarkedFace(FaceGeometry(model), front_view(model))


def check_jacobian(term: PairDistances, state: State, block: str) -> None:
    """Every seventh column of ``block`` against central differences at ``state``."""
    layout, step = Layout(state), 1e-5
    jacobian = term.jacobian(state, layout)
    where = layout.slices[block]
    for column in range(where.start, where.stop, 7):
        increment = np.zeros(layout.size)
        increment[column] = step
        plus, minus = (term.residuals(layout.apply(state, sign * increment)) for sign in (1, -1))
        wanted = (plus - minus) / (2 * step)
        np.testing.assert_allclose(jacobian[:, column], wanted, rtol=1e-5, atol=1e-5)
