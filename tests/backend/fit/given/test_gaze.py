"""What ties the looks of both eyes, in models that have them all and in others."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.face_model import FaceModel
from facestage.contract.landmarks import Landmarks
from facestage.fit.face.gaussians import independent, tied
from facestage.fit.given.gaze import APART_SIGMA, looks_apart
from facestage.models.mesh.skinning import gaze_rotations
from reference.landmarked_face import landmarked_face
from reference.normal_equations import normal_equations

# Pairs that look the same way, of the right eye and of the left one.
TOGETHER = [("Out", "In"), ("In", "Out"), ("Up", "Up"), ("Down", "Down")]


@pytest.fixture(scope="module")
def model() -> FaceModel:
    return landmarked_face().geometry.model


def ties_of(model: FaceModel) -> np.ndarray:
    """Of a photo that shows both irises."""
    face = landmarked_face()
    ties = looks_apart(model, face.landmarks(face.state))
    assert ties is not None
    return ties


def named(model: FaceModel, **weights: float) -> np.ndarray:
    return np.array([weights.get(name, 0.0) for name in model.expression_names])


@pytest.mark.parametrize(("right", "left"), TOGETHER)
def test_eyes_that_look_the_same_way_are_free_to(model: FaceModel, right: str, left: str):
    ties = ties_of(model)
    one = named(model, **{f"eyeLook{right}Right": 0.8})
    both = one + named(model, **{f"eyeLook{left}Left": 0.8})
    assert np.abs(ties @ both).max() < 1e-12
    assert np.linalg.norm(ties @ one) == pytest.approx(0.8 / APART_SIGMA)


def test_nothing_but_looks_is_tied(model: FaceModel):
    names = np.array(model.expression_names)[ties_of(model).any(axis=0)]
    assert len(names) == 8 and all(name.startswith("eyeLook") for name in names)


def test_names_of_other_models_mean_the_same(model: FaceModel):
    """Turned about the joints by the published convention, both eyes go the same way."""
    rotations = gaze_rotations()
    names = [*rotations, *(f"other{k}" for k in range(len(model.expression_names) - 8))]
    ties = ties_of(replace(model, expression_names=tuple(names)))
    for direction in np.eye(3)[:2]:
        for sign in (1, -1):
            moves = [max(0.0, sign * float(each @ direction)) for each in rotations.values()]
            weights = np.zeros(len(names))
            weights[:8] = np.array(moves) > 0
            assert weights.sum() == 2
            assert np.abs(ties @ weights).max() < 1e-12


def test_a_model_without_all_looks_has_no_ties(model: FaceModel):
    face = landmarked_face()
    names = tuple(name.replace("eyeLookUpLeft", "upwards") for name in model.expression_names)
    assert looks_apart(replace(model, expression_names=names), face.landmarks(face.state)) is None


def test_a_photo_that_shows_no_iris_ties_nothing(model: FaceModel):
    face = landmarked_face()
    shut = face.landmarks(face.with_weights(eyeBlinkLeft=1.0, eyeBlinkRight=1.0))
    assert looks_apart(model, shut) is None
    assert looks_apart(model, face.landmarks(face.with_weights(eyeBlinkLeft=1.0))) is not None
    assert looks_apart(model, Landmarks("ibug68", np.zeros((68, 2)), np.ones(68, bool))) is None


def test_tied_values_cost_what_their_sums_are_off():
    prior = tied(independent(3, 0.0, 2.0), np.array([[4.0, -4.0, 0.0]]))
    np.testing.assert_allclose(prior.residuals(np.array([2.0, 1.0, 4.0])), [1.0, 0.5, 2.0, 4.0])
    apart = np.array([[16, -16, 0], [-16, 16, 0], [0, 0, 0]])
    hessian = normal_equations(prior, np.zeros(3))[0]
    np.testing.assert_allclose(hessian, np.diag([0.25] * 3) + apart)
