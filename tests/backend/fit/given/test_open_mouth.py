"""Landmarks of an open mouth and narrowed eyes on a known default head: the landmark stage finds
both.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.face_model import FaceModel
from facestage.contract.job import Weights
from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.landmark_term import LANDMARK_SIGMA_SHARE, LandmarkTerm, landmark_pixels
from facestage.fit.energy.priors import Priors
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.unknowns import SHAPE, Known
from facestage.fit.given.face_areas import face_size_px
from facestage.fit.stages.photo_descent import PhotoDescent
from facestage.models.anatomy.landmark_schemes import scheme_of
from facestage.models.registry import load_model
from reference.front_view import front_view

SCHEME = "mediapipe478"
LIPS, RIGHT_LIDS, LEFT_LIDS = (13, 14), (159, 145), (386, 374)
SMILE = {
    "jawOpen": 0.35,
    "mouthSmileLeft": 0.6,
    "mouthSmileRight": 0.6,
    "AU46_wink_left": 0.3,
    "AU46_wink_right": 0.3,
}


@pytest.fixture(scope="module")
def model() -> FaceModel:
    return load_model("default")


def gap(points: np.ndarray, pair: tuple[int, int]) -> float:
    return float(np.linalg.norm(points[pair[0]] - points[pair[1]]))


def test_a_broad_smile_opens_the_mouth_and_leaves_the_lids(model: FaceModel):
    geometry = FaceGeometry(model)
    lights = LightParameters(np.zeros(1, bool), np.ones((1, 3)), False)
    mean = front_view(model)
    random = np.random.default_rng(5)
    smile = np.array([SMILE.get(name, 0.0) for name in model.expression_names])
    true = replace(mean, expression=smile, identity=0.6 * random.normal(size=len(mean.identity)))
    blank = Landmarks(SCHEME, np.zeros((478, 2)), np.ones(478, bool))
    exact = landmark_pixels(geometry, blank, true)
    size = face_size_px(replace(blank, points=exact))
    # Neighbors err together: the whole face by more than a lip against the other.
    found = exact + LANDMARK_SIGMA_SHARE * size * (
        random.normal(size=2)
        + 0.3 * scheme_of(SCHEME).deviation[:, None] * random.normal(size=(478, 2))
    )
    landmarks = replace(blank, points=found)
    layout = Layout(mean)
    known = Known(lights, mean.camera.focal_px, expression_box=model.expression_box)
    low, high = layout.bounds(known)
    state = mean
    for blocks in (("pose",), SHAPE):
        priors = Priors(layout, known, Weights())
        term = LandmarkTerm(geometry, landmarks, LANDMARK_SIGMA_SHARE * size)
        held = ~layout.mask(blocks) | layout.mask(("focal",))
        stage = PhotoDescent(
            "landmarks", blocks, Energy(layout, (priors, term)), 30, held, low, high
        )
        for step in stage.run(state, 0, np.inf):
            state = step.state
    fitted = landmark_pixels(geometry, landmarks, state)
    for pair, name, least in (
        (LIPS, "lips", 0.96),
        (RIGHT_LIDS, "right lids", 0.93),
        (LEFT_LIDS, "left lids", 0.93),
    ):
        share = gap(fitted, pair) / gap(exact, pair)
        print(
            f"{name}: {share:.3f} of the true {gap(exact, pair):.1f} px, margin "
            f"{abs(1 - share) / (1 - least):.2f}"
        )
        assert least < share < 2 - least
