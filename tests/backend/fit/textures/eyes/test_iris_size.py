"""Irises as large as the photo's, beside the lids of a head that may be of any size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.landmark_term import landmark_pixels
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.textures.eyes.eye_pattern import eye_albedo
from facestage.fit.textures.eyes.iris_size import LARGEST, SMALLEST, iris_size
from facestage.models.anatomy.landmark_schemes import scheme_of
from facestage.models.anatomy.regions import IRIS_RADIUS
from facestage.models.registry import load_model
from reference.front_view import front_view

SCHEME = "mediapipe478"


def seen(size: float) -> tuple[FaceGeometry, State, Landmarks]:
    """The mean head, and landmarks of it with irises of this size."""
    model = load_model("default")
    geometry, state = FaceGeometry(model), front_view(model)
    blank = Landmarks(SCHEME, np.zeros((478, 2)), np.ones(478, bool))
    points = landmark_pixels(geometry, blank, state)
    for eye in scheme_of(SCHEME).eyes:
        at = list(eye.iris)
        points[at] = points[at[0]] + size * (points[at] - points[at[0]])
    return geometry, state, replace(blank, points=points)


@pytest.mark.parametrize(
    ("true", "found"), [(1.0, 1.0), (0.9, 0.9), (0.5, SMALLEST), (1.5, LARGEST)]
)
def test_a_known_size_is_found(true: float, found: float):
    assert iris_size(*seen(true)) == pytest.approx(found, abs=0.01)


def test_landmarks_without_irises_say_nothing():
    geometry, state, landmarks = seen(0.9)
    hidden = landmarks.visible.copy()
    for eye in scheme_of(SCHEME).eyes:
        hidden[list(eye.iris)] = False
    assert iris_size(geometry, state, replace(landmarks, visible=hidden)) == 1.0
    sparse = Landmarks("ibug68", np.zeros((68, 2)), np.ones(68, bool))
    assert iris_size(geometry, state, sparse) == 1.0


def test_a_smaller_iris_ends_nearer_to_the_axis():
    radius = np.linspace(0.001, 0.009, 400)
    across = np.stack([radius, np.zeros(400)], axis=1)
    ends = []
    for size in (1.0, 0.85):
        drawn = eye_albedo(across, np.full(3, 0.05), np.full(3, 0.6), size=size).mean(axis=1)
        ends.append(radius[np.flatnonzero(drawn < 0.2).max()])
    assert ends[0] == pytest.approx(IRIS_RADIUS, abs=0.0004)
    assert ends[1] / ends[0] == pytest.approx(0.85, abs=0.02)
