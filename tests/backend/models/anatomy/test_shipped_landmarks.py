"""MediaPipe's 478 landmarks on the meshes that Facestage knows: where they must lie, whichever mesh
it is.
"""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.face_model import EYES, SKIN, FaceModel
from facestage.contract.landmarks import SCHEME_SIZES
from facestage.models.anatomy.landmark_schemes import scheme_of
from facestage.models.anatomy.shipped_landmarks import SCHEME, read_table
from facestage.models.registry import load_model

MM = 1e-3
# The same points of both schemes: corners of eyes and mouth, middle of the lips, below the nose.
SHARED = (
    (36, 33),
    (39, 133),
    (42, 362),
    (45, 263),
    (48, 61),
    (54, 291),
    (51, 0),
    (57, 17),
    (62, 13),
    (66, 14),
    (33, 2),
)
# Of the subject's right side and of the left.
PARTNERS = (
    (33, 263),
    (133, 362),
    (61, 291),
    (50, 280),
    (234, 454),
    (58, 288),
    (70, 300),
    (468, 473),
    (159, 386),
)
MIDDLE = (10, 168, 6, 1, 0, 13, 14, 17, 152)


@pytest.fixture(scope="module", params=["default", "ict"])
def model(request: pytest.FixtureRequest) -> FaceModel:
    if request.param == "default":
        return load_model("default")
    ict: FaceModel = request.getfixturevalue("ict_facekit")
    return ict


def places(model: FaceModel, scheme: str) -> np.ndarray:
    corners, weights = model.landmark_vertices(scheme)
    return np.einsum("mi,mix->mx", weights, model.vertices[corners])


def test_points_lie_where_they_were_found_on_the_right_parts(model: FaceModel):
    table, positions = read_table("default" if model.name == "default" else "ict")
    assert table.shape == (478, 6) and np.isfinite(table).all()
    np.testing.assert_allclose(table[:, 3:].sum(axis=1), 1, atol=1e-5)
    assert table[:, 3:].min() >= -1e-6
    moved = np.linalg.norm(places(model, SCHEME) - positions, axis=1).max() / MM
    print(
        f"largest distance from where the points were found: {moved:.1e} mm, margin "
        f"{0.5 / max(moved, 1e-9):.0f}x"
    )
    assert moved < 0.5, "the mesh has changed: run tools/derive_landmarks.py again"
    for part, points in ((SKIN, slice(0, 468)), (EYES, slice(468, 478))):
        known = {
            frozenset(triangle)
            for triangle in model.triangles[model.triangle_part == part].tolist()
        }
        assert all(
            frozenset(corners) in known for corners in table[points, :3].astype(int).tolist()
        )


def test_left_and_right_mirror_each_other(model: FaceModel):
    points = places(model, SCHEME) / MM
    for right, left in PARTNERS:
        assert points[right, 0] < 0 < points[left, 0]
        assert np.linalg.norm(points[right] * [-1, 1, 1] - points[left]) < 0.7, (right, left)
    assert np.abs(points[list(MIDDLE), 0]).max() < 0.5


def test_points_agree_with_the_other_scheme(model: FaceModel):
    ibug68, found = places(model, "ibug68") / MM, places(model, SCHEME) / MM
    for one, other in SHARED:
        distance = np.linalg.norm(ibug68[one] - found[other])
        assert distance < 5.5, (
            f"points {one} of ibug68 and {other} of {SCHEME} are {distance:.1f} mm apart"
        )
    for eye, ring in (("eye_right", range(469, 473)), ("eye_left", range(474, 478))):
        radius = np.linalg.norm(found[list(ring), :2] - found[ring.start - 1, :2], axis=1)
        assert (radius > 4).all() and (radius < 8).all()
        centre = model.vertices[model.regions[eye]].mean(axis=0) / MM
        assert np.linalg.norm(found[ring.start - 1, :2] - centre[:2]) < 2


@pytest.mark.parametrize("name", SCHEME_SIZES)
def test_schemes_name_points_that_they_have(name: str):
    scheme, count = scheme_of(name), SCHEME_SIZES[name]
    assert scheme.deviation.shape == (count,) and (scheme.deviation > 0).all()
    assert scheme.share.shape == (count,) and (scheme.share > 0).all() and (scheme.share <= 1).all()
    for points in (scheme.contour, scheme.outline, scheme.skin, *scheme.openings):
        assert len(np.unique(points)) == len(points) and points.min() >= 0 and points.max() < count


def test_eye_corners_are_sharper_than_the_cheek_and_the_outline():
    deviation = scheme_of(SCHEME).deviation
    corners, cheeks = deviation[[33, 133, 362, 263]].max(), deviation[[50, 280, 205, 425]].min()
    assert corners < cheeks and corners < 0.5 * np.median(deviation[scheme_of(SCHEME).contour])


def test_the_iris_of_a_closed_eye_is_a_guess(model: FaceModel):
    scheme, points = scheme_of(SCHEME), places(model, SCHEME)[:, :2]
    assert not scheme.behind_closed_lids(points).any()
    points[159] = points[145]
    assert np.flatnonzero(scheme.behind_closed_lids(points)).tolist() == [468, 469, 470, 471, 472]
    assert not scheme_of("ibug68").behind_closed_lids(points[:68]).any()
