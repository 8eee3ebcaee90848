"""Gaze: residuals, Jacobian, where the term is silent, and how far a landmark stage turns eyes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from facestage.fit.energy.gaze_term import SIGMA_SHARE, GazeTerm
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.gaze import looks_apart
from facestage.fit.given.lids import seen_lids
from facestage.fit.given.problem import read_problem
from facestage.fit.stages.passage import walk
from facestage.fit.stages.phases import default_schedule
from facestage.fit.stages.view import View
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.landmarked_face import SCHEME, check_jacobian, landmarked_face
from reference.landmarked_face import LandmarkedFace as Face
from reference.small_fit import QUICK

ASIDE = {"eyeLookOutLeft": 0.9, "eyeLookInRight": 0.9}


@pytest.fixture(scope="module")
def face() -> Face:
    return landmarked_face()


def found_by(face: Face, landmarks: Landmarks) -> GazeTerm:
    term = GazeTerm.seen(face.geometry, landmarks)
    assert term is not None
    return term


def places(face: Face, state: State) -> np.ndarray:
    """(2, 2) where the irises are from the middle of the corners, along the eye and up, in shares
    of its width.
    """
    landmarks = face.landmarks(state)
    found = []
    for eye, lids in zip(scheme_of(SCHEME).eyes, seen_lids(landmarks), strict=True):
        assert lids is not None
        middle = landmarks.points[list(eye.corners)].mean(axis=0)
        axes = np.array([[-lids.across[1], lids.across[0]], lids.across])
        found.append(axes @ (landmarks.points[eye.iris[0]] - middle) / lids.width)
    return np.array(found)


def test_residuals_are_zero_at_the_truth_and_say_how_far_irises_are_off(face: Face):
    aside = face.with_weights(**ASIDE)
    term = found_by(face, face.landmarks(aside))
    assert np.abs(term.residuals(aside)).max() < 1e-9
    # Eyes, corners, axes: the mean of the corners is their middle.
    off = term.residuals(face.state).reshape(2, 2, 2).mean(axis=1) * SIGMA_SHARE
    expected = places(face, face.state) - places(face, aside)
    assert np.abs(expected[:, 0]).min() > 0.1
    np.testing.assert_allclose(off, expected, atol=0.004)


@pytest.mark.parametrize("block", ["pose", "focal", "identity", "expression"])
def test_jacobian_equals_finite_differences(face: Face, block: str):
    term = found_by(face, face.landmarks(face.with_weights(**ASIDE)))
    check_jacobian(term, face.state, block)


def test_an_eye_that_is_shut_or_hidden_says_nothing(face: Face):
    landmarks = face.landmarks(face.with_weights(eyeBlinkLeft=1.0))
    right, _ = scheme_of(SCHEME).eyes
    assert len(found_by(face, landmarks).apart) == 4
    hidden = landmarks.visible.copy()
    hidden[right.corners[1]] = False
    assert GazeTerm.seen(face.geometry, replace(landmarks, visible=hidden)) is None
    hidden[right.corners[1]], hidden[right.iris[3]] = True, False
    assert GazeTerm.seen(face.geometry, replace(landmarks, visible=hidden)) is None
    sparse = Landmarks("ibug68", np.zeros((68, 2)), np.ones(68, bool))
    assert GazeTerm.seen(face.geometry, sparse) is None


@pytest.mark.parametrize(("with_term", "least", "most"), [(True, 0.8, 1.05), (False, 0.2, 0.7)])
def test_a_landmark_stage_turns_the_eyes(face: Face, with_term: bool, least: float, most: float):
    """Points alone leave eyes that look aside looking half as far."""
    true = face.with_weights(**ASIDE)
    landmarks = face.found(true, np.random.default_rng(5))
    terms = (found_by(face, landmarks),) if with_term else ()
    ties = looks_apart(face.geometry.model, landmarks)
    state = face.landmark_stage(landmarks, *terms, expression_ties=ties)
    straight, there, here = (places(face, each)[:, 0] for each in (face.state, true, state))
    share = (here - straight) / (there - straight)
    print(f"of the look aside {share} found")
    assert (share > least).all()
    assert (share < most).all()


def test_an_eye_that_does_not_show_looks_where_the_other_one_does(face: Face):
    model = face.geometry.model
    true = face.with_weights(**ASIDE)
    landmarks = face.landmarks(true)
    left = scheme_of(SCHEME).eyes[1]
    weights = np.ones(478)
    weights[[*left.iris, *left.corners]] = 0.0
    landmarks = replace(landmarks, weights=weights)
    term = found_by(face, landmarks)
    assert len(term.apart) == 4
    straight, there = (places(face, each)[1, 0] for each in (face.state, true))
    shares = []
    for ties in (None, looks_apart(model, landmarks)):
        state = face.landmark_stage(landmarks, term, expression_ties=ties)
        shares.append((places(face, state)[1, 0] - straight) / (there - straight))
    print(f"of the look aside {shares[0]:.2f} found by itself, {shares[1]:.2f} with the other eye")
    assert shares[0] < 0.1 and shares[1] > 0.5


@pytest.mark.usefixtures("renderer")
def test_the_landmark_phases_of_a_fit_turn_both_eyes(face: Face, tmp_path: Path):
    """One by its iris, and the other, which does not show, with it."""
    true = face.with_weights(**ASIDE)
    weights = np.ones(478)
    weights[[*scheme_of(SCHEME).eyes[1].iris, *scheme_of(SCHEME).eyes[1].corners]] = 0.0
    landmarks = replace(face.landmarks(true), weights=weights)
    photo, camera = tmp_path / "photo.png", face.state.camera
    assert cv2.imwrite(str(photo), np.full((camera.height, camera.width, 3), 150, np.uint8))
    job = Job(photo, "default", landmarks, camera, stage=fibonacci_stage(4), device="cpu")
    problem = read_problem(job, fineness=QUICK)
    view = View(problem, ForwardModel(problem.geometry, problem.lights))
    phases = default_schedule(job, QUICK.steps_max).landmark_phases
    state = walk(view, phases, view.start_state(), np.inf)
    straight = replace(state, expression=np.zeros_like(state.expression))
    places_of = [places(face, each)[:, 0] for each in (face.state, true, straight, state)]
    share = (places_of[3] - places_of[2]) / (places_of[1] - places_of[0])
    print(f"of the look aside {share} found by a fit")
    assert 0.6 < share[0] < 1.0
    assert 0.5 < share[1] < 1.0
