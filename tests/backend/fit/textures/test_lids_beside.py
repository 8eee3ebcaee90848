"""Where a photo shows the skin of lids that lie beside the fitted ones."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.landmarks import Landmarks
from facestage.fit.textures.lids_beside import FARTHEST, LASHES, NOISE, REACH, lids_beside
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.landmarked_face import SCHEME, landmarked_face

FACE_PX, DARK = 400.0, 1.2
RINGS = scheme_of(SCHEME).openings[1:]
LIDS = np.concatenate(RINGS)


@pytest.fixture(scope="module")
def found() -> Landmarks:
    face = landmarked_face()
    landmarks = face.landmarks(face.state)
    outline = landmarks.points[scheme_of(SCHEME).outline]
    return replace(landmarks, points=landmarks.points * FACE_PX / np.ptp(outline, axis=0).max())


def moved(found: Landmarks, lids: np.ndarray, by: np.ndarray) -> Landmarks:
    points = found.points.copy()
    points[lids] += by
    return replace(found, points=points)


def test_at_its_border_a_lid_is_read_where_its_landmarks_are(found: Landmarks):
    by = np.array([1.0, -4.0])
    shift = lids_beside(
        found.points[LIDS], moved(found, LIDS, by), found.points, FACE_PX, DARK
    ).shift
    length = np.linalg.norm(by)
    assert shift == pytest.approx(
        np.tile(by * (1 - (NOISE * FACE_PX / length) ** 2), (len(LIDS), 1)), abs=1e-6
    )


def test_a_landmark_s_own_error_moves_nothing(found: Landmarks):
    by = np.array([0.9 * NOISE * FACE_PX, 0.0])
    beside = lids_beside(found.points[LIDS], moved(found, LIDS, by), found.points, FACE_PX, DARK)
    assert not beside.shift.any()


def test_no_pixel_is_read_farther_than_lids_can_be_off(found: Landmarks):
    by = np.array([0.0, 60.0])
    beside = lids_beside(found.points[LIDS], moved(found, LIDS, by), found.points, FACE_PX, DARK)
    assert np.linalg.norm(beside.shift, axis=1) == pytest.approx(
        np.full(len(LIDS), FARTHEST * FACE_PX), rel=0.02
    )


def test_the_shift_fades_until_the_skin_is_none_of_the_lids_(found: Landmarks):
    above = found.points[159] - np.linspace(0.0, 1.5 * REACH * FACE_PX, 60)[:, None] * [0.0, 1.0]
    by = np.array([0.0, 4.0])
    shift = lids_beside(above, moved(found, LIDS, by), found.points, FACE_PX, DARK).shift[:, 1]
    # No pixel is passed over or read twice the wrong way round.
    assert (np.diff(shift) <= 1e-9).all() and shift[0] > 3.5 and np.diff(shift).min() > -0.4
    assert (shift[above[:, 1] < found.points[159, 1] - REACH * FACE_PX] == 0.0).all()
    assert (np.diff(above[:, 1] + shift) < 0).all()


def test_each_lid_has_its_own_shift_and_a_hidden_eye_none(found: Landmarks):
    left, right = (found.points[ring] for ring in RINGS)
    one = moved(found, RINGS[0], np.array([0.0, 4.0]))
    assert (lids_beside(left, one, found.points, FACE_PX, DARK).shift[:, 1] > 3.0).all()
    assert not lids_beside(right, one, found.points, FACE_PX, DARK).shift.any()
    visible = np.ones(len(found.points), bool)
    visible[RINGS[0][3]] = False
    hidden = lids_beside(left, replace(one, visible=visible), found.points, FACE_PX, DARK)
    assert not hidden.shift.any() and not hidden.lashes.any()


def test_lashes_grow_along_the_upper_lid(found: Landmarks):
    for ring in RINGS:
        half = len(ring) // 2
        upper, lower = found.points[ring[half + 1 :]], found.points[ring[1:half]]
        near, far = (np.array([0.0, -share * LASHES * FACE_PX]) for share in (0.7, 2.0))
        place = np.concatenate([upper + near, upper + far, lower])
        lashes = lids_beside(place, found, found.points, FACE_PX, DARK).lashes
        first, second, third = np.split(lashes, [len(upper), 2 * len(upper)])
        assert first.all() and not second.any() and not third.any()


def test_landmarks_that_say_little_of_lids_shift_nothing():
    points = np.random.default_rng(0).uniform(0, FACE_PX, (68, 2))
    few = Landmarks("ibug68", points, np.ones(68, bool))
    beside = lids_beside(points, few, points + 5.0, FACE_PX, DARK)
    assert not beside.shift.any() and not beside.lashes.any()


@pytest.mark.parametrize(("depth", "share"), [(0.0, 0.0), (0.4, 0.0), (0.55, 0.5), (0.7, 1.0)])
def test_lids_without_a_line_of_lashes_are_where_they_were_fitted(
    found: Landmarks, depth: float, share: float
):
    by = moved(found, LIDS, np.array([0.0, 4.0]))
    whole = lids_beside(found.points[LIDS], by, found.points, FACE_PX, DARK)
    some = lids_beside(found.points[LIDS], by, found.points, FACE_PX, depth)
    np.testing.assert_allclose(some.shift, share * whole.shift, atol=1e-9)
    np.testing.assert_allclose(some.lashes, share * whole.lashes, atol=1e-9)
    assert whole.lashes.any()
