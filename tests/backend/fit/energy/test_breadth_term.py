"""Breadths: residuals, Jacobian, where the term is silent, and a wide face that it leaves wide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.breadth_term import SIGMA_SHARE, Breadths, BreadthTerm
from facestage.fit.face.state import State
from facestage.fit.given.face_areas import face_size_px
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.landmarked_face import SCHEME, LandmarkedFace, check_jacobian, landmarked_face

PAIRS = scheme_of(SCHEME).breadths


@pytest.fixture(scope="module")
def face() -> LandmarkedFace:
    return landmarked_face()


def shaped(face: LandmarkedFace, **weights: float) -> State:
    """The face with these modes of identity."""
    names = face.geometry.model.identity_names
    return replace(face.state, identity=np.array([weights.get(n, 0.0) for n in names]))


def turned(state: State, degrees: float) -> State:
    """Aside."""
    yaw = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
    return replace(state, rotation=yaw @ state.rotation)


def found_by(face: LandmarkedFace, landmarks: Landmarks) -> BreadthTerm:
    term = BreadthTerm.seen(face.geometry, landmarks)
    assert term is not None
    return term


def widths(landmarks: Landmarks) -> np.ndarray:
    """Of the face from side to side, pixels."""
    first, second = np.moveaxis(landmarks.points[PAIRS], 1, 0)
    return np.linalg.norm(first - second, axis=1)


def test_pairs_face_each_other_across_the_face(face: LandmarkedFace):
    first, second = np.moveaxis(face.landmarks(face.state).points[PAIRS], 1, 0)
    assert (np.abs((first - second)[:, 1]) < 0.02 * np.abs((first - second)[:, 0])).all()
    np.testing.assert_allclose((first + second)[:, 0] / 2, face.state.camera.width / 2, atol=2)


def test_residuals_are_zero_at_the_truth_and_count_what_a_face_is_wider(face: LandmarkedFace):
    wide = shaped(face, bizygomatic_breadth=2.0)
    landmarks = face.landmarks(wide)
    term = found_by(face, landmarks)
    found = term.at(wide)
    assert isinstance(found, Breadths) and np.abs(found.residuals(wide)).max() < 1e-9
    off = found.residuals(face.state) * SIGMA_SHARE * face_size_px(landmarks)
    expected = widths(face.landmarks(face.state)) - widths(landmarks)
    assert expected.min() < -4
    np.testing.assert_allclose(off, expected, rtol=0.02, atol=0.05)


@pytest.mark.parametrize("block", ["pose", "focal", "identity", "expression"])
def test_jacobian_equals_finite_differences(face: LandmarkedFace, block: str):
    term = found_by(face, face.landmarks(shaped(face, jaw_angle_width=1.0))).at(face.state)
    assert term is not None
    check_jacobian(term, face.state, block)


def test_a_head_that_is_turned_aside_says_nothing(face: LandmarkedFace):
    term = found_by(face, face.landmarks(face.state))
    weights = []
    for degrees in (0, 10, 20, -20, 30, -90):
        placed = term.at(turned(face.state, degrees))
        weights.append(0.0 if placed is None else placed.weight)
    assert weights[:2] == [1.0, 1.0] and weights[4:] == [0.0, 0.0]
    assert min(weights[2:4]) > 0.2 and max(weights[2:4]) < 0.8


def test_points_that_are_left_out_do_not_count_and_hidden_ones_do(face: LandmarkedFace):
    landmarks = face.landmarks(face.state)
    visible = np.ones(478, bool)
    visible[PAIRS] = False
    hidden = replace(landmarks, visible=visible)
    assert len(found_by(face, hidden).breadths.apart) == len(PAIRS)
    weights = np.ones(478)
    weights[PAIRS[3, 0]] = 0.0
    assert len(found_by(face, replace(landmarks, weights=weights)).breadths.apart) == len(PAIRS) - 1
    weights[PAIRS] = 0.0
    assert BreadthTerm.seen(face.geometry, replace(landmarks, weights=weights)) is None
    sparse = Landmarks("ibug68", np.zeros((68, 2)), np.ones(68, bool))
    assert BreadthTerm.seen(face.geometry, sparse) is None


def test_a_landmark_stage_leaves_a_wide_face_wide(face: LandmarkedFace):
    """Points alone, hidden at the outline as a detector has them, made it narrower by a fortieth
    of its size.
    """
    true = shaped(face, bizygomatic_breadth=2.0, jaw_angle_width=1.5)
    visible = np.ones(478, bool)
    visible[PAIRS] = False
    landmarks = replace(face.found(true, np.random.default_rng(5)), visible=visible)
    size = face_size_px(face.landmarks(true))
    off = []
    for terms in ((), (found_by(face, landmarks),)):
        state = face.landmark_stage(landmarks, *terms)
        off.append(float((widths(face.landmarks(state)) - widths(landmarks)).mean()) / size)
    print(f"breadth off by points alone {off[0]:.3f} of the face, with breadths {off[1]:.3f}")
    assert off[0] < -0.02 and abs(off[1]) < 0.01
