"""The canonical face, which points of a mesh are seen, and the conversion to ibug68."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.landmarks import Landmarks
from facestage.landmarks.canonical import SURFACE_COUNT, CanonicalFace, read_canonical
from facestage.landmarks.face_mesh import COUNT
from facestage.landmarks.ibug68 import FIRST, SECOND, SHARE, to_ibug68
from facestage.landmarks.model_file import Bundle
from facestage.landmarks.visibility import GRAZING, visible_points
from reference.rendering.intersect import intersections

NOSE_TIP, CHIN, RIGHT_EYE, LEFT_EYE, RIGHT_EAR, LEFT_EAR = 1, 152, 33, 263, 234, 454


@pytest.fixture(scope="session")
def canonical(bundle: Bundle) -> CanonicalFace:
    return read_canonical(bundle.geometry)


def turned(face: CanonicalFace, yaw: float) -> np.ndarray:
    """(478, 3) the canonical face with flat irises, turned by ``yaw`` degrees to the picture's
    right, as a mesh.
    """
    points = np.zeros((COUNT, 3))
    points[:SURFACE_COUNT] = face.vertices
    for start, corners in ((468, (33, 133)), (473, (263, 362))):
        points[start : start + 5] = face.vertices[list(corners)].mean(axis=0)
    cosine, sine = np.cos(np.radians(yaw)), np.sin(np.radians(yaw))
    rotated = points @ np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]]).T
    return rotated * [1, -1, -1]


def test_the_canonical_face_looks_out_of_the_picture(canonical: CanonicalFace):
    vertices = canonical.vertices
    assert vertices[:, 2].argmax() in (NOSE_TIP, 4) and vertices[CHIN, 1] < vertices[NOSE_TIP, 1]
    assert vertices[RIGHT_EYE, 0] < 0 < vertices[LEFT_EYE, 0], (
        "the person's right is the picture's left"
    )
    a, b, c = vertices[canonical.triangles].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] > 0).mean() > 0.85, "triangles turn outward"


def test_mirroring_pairs_left_and_right(canonical: CanonicalFace):
    mirror = canonical.mirror
    np.testing.assert_array_equal(mirror[mirror], np.arange(COUNT))
    assert (
        mirror[RIGHT_EYE] == LEFT_EYE
        and mirror[NOSE_TIP] == NOSE_TIP
        and mirror[RIGHT_EAR] == LEFT_EAR
    )
    assert mirror[468] == 473 and mirror[469] == 476 and mirror[470] == 475
    # The conversion to ibug68 is as symmetric as its scheme.
    swap = [*range(16, -1, -1), *range(26, 16, -1), 27, 28, 29, 30, 35, 34, 33, 32, 31, 45, 44,
    43, 42, 47, 46, 39, 38,
            37, 36, 41, 40, 54, 53, 52, 51, 50, 49, 48, 59, 58, 57, 56, 55, 64, 63, 62, 61, 60,
            67, 66, 65]  # fmt: skip
    np.testing.assert_array_equal(
        np.where(SHARE < 1, mirror[FIRST], -1)[swap], np.where(SHARE < 1, FIRST, -1)
    )
    np.testing.assert_array_equal(
        np.where(SHARE > 0, mirror[SECOND], -1)[swap], np.where(SHARE > 0, SECOND, -1)
    )
    np.testing.assert_array_equal(SHARE[swap], SHARE)


def test_edges_are_those_of_the_triangles(canonical: CanonicalFace):
    expected = {
        frozenset((int(triangle[i]), int(triangle[i - 1])))
        for triangle in canonical.triangles
        for i in range(3)
    }
    assert {frozenset(edge) for edge in canonical.edges.tolist()} == expected


@pytest.mark.parametrize(
    "damage", [lambda data: data[:100], lambda data: b"", lambda data: b"\xff" * 50]
)
def test_damaged_geometry_is_refused(bundle: Bundle, damage):
    with pytest.raises(InputError, match="landmark model"):
        read_canonical(damage(bundle.geometry))


def test_a_frontal_face_is_all_seen_and_a_turned_one_half(canonical: CanonicalFace):
    front = visible_points(turned(canonical, 0), canonical)
    assert front.mean() > 0.9 and front[[NOSE_TIP, CHIN, RIGHT_EYE, LEFT_EYE, 468, 473]].all()
    for yaw, far, near in ((60, LEFT_EAR, RIGHT_EAR), (-60, RIGHT_EAR, LEFT_EAR)):
        seen = visible_points(turned(canonical, yaw), canonical)
        assert not seen[far] and seen[near] and 0.35 < seen.mean() < 0.8
        iris = {LEFT_EAR: (473, 468), RIGHT_EAR: (468, 473)}[far]
        assert not seen[iris[0]] and seen[iris[1]]
    assert visible_points(turned(canonical, 180), canonical)[:SURFACE_COUNT].mean() < 0.1


@pytest.mark.parametrize("yaw", [0, 35, -70])
def test_what_is_seen_is_what_rays_reach(canonical: CanonicalFace, yaw: float):
    mesh = turned(canonical, yaw)
    points, triangles = mesh[:SURFACE_COUNT], canonical.triangles
    seen = visible_points(mesh, canonical)[:SURFACE_COUNT]
    towards = np.array([0.0, 0.0, -1.0])
    for number in range(0, SURFACE_COUNT, 7):
        mine = triangles[(triangles == number).any(axis=1)]
        a, b, c = points[mine].transpose(1, 0, 2)
        normal = np.cross(b - a, c - a).sum(axis=0)
        facing = -normal[2] / np.linalg.norm(normal)
        # Far off along the ray, so that the margin for wrong depths does not matter.
        distance, _, _ = intersections(points[number], towards[None], points, triangles)
        others = ~(triangles == number).any(axis=1)
        blocked = np.isfinite(distance[0][others]) & (distance[0][others] > 2.0)
        grazed = np.isfinite(distance[0][others]) & (distance[0][others] > 0.2)
        if abs(facing - GRAZING) < 0.02 or blocked.any() != grazed.any():
            continue
        assert seen[number] == (facing > GRAZING and not blocked.any()), number


def test_closed_eyes_hide_the_iris(canonical: CanonicalFace):
    mesh = turned(canonical, 0)
    mesh[159] = mesh[145]
    seen = visible_points(mesh, canonical)
    assert not seen[468:473].any() and seen[473:].all()


def test_a_converted_point_is_seen_where_its_sources_are():
    points = np.random.default_rng(0).uniform(0, 100, (COUNT, 2))
    visible = np.ones(COUNT, bool)
    visible[[30, 234]] = False
    converted = to_ibug68(Landmarks("mediapipe478", points, visible))
    assert converted.scheme == "ibug68" and converted.points.shape == (68, 2)
    assert np.flatnonzero(~converted.visible).tolist() == [1]
    np.testing.assert_allclose(converted.points[36], points[33])
    np.testing.assert_allclose(converted.points[7], 0.4 * points[176] + 0.6 * points[148])
