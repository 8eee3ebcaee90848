"""Which vertices are the face: seen from the front, within the landmarks."""

from __future__ import annotations

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.face_model import FaceModel


def test_the_hull_holds_what_lies_between_its_corners() -> None:
    from facestage_blender.synthetic.scans.face_region import within_hull

    corners = np.array([[0, 0], [10, 0], [10, 10], [0, 10], [5, 5], [9, 1]], float)
    points = np.array([[5, 5], [0.1, 9.9], [-0.1, 5], [10.1, 5], [5, 11]])
    for order in (slice(None), slice(None, None, -1)):
        assert within_hull(points, corners[order]).tolist() == [True, True, False, False, False]


def test_the_face_is_what_a_camera_sees_between_the_landmarks(head: FaceModel) -> None:
    from facestage_blender.synthetic.scans.face_region import face_vertices

    vertices = 1e3 * head.vertices + np.array([0, 0, -900.0])
    camera = Camera.default(256, 256, 500.0)
    centre = camera.project(vertices.mean(axis=0)[None])[0]
    square = centre + 15 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    found = face_vertices(vertices, head.triangles, camera, square)
    pixels = camera.project(vertices)
    inside = (np.abs(pixels - centre) < 15).all(axis=1)
    # Of an egg: the vertices of its front in the square, none of those behind.
    front = inside & (vertices[:, 2] > np.median(vertices[:, 2]))
    np.testing.assert_array_equal(found, np.flatnonzero(front))
    assert (inside & ~front).any()


def test_what_is_seen_at_a_grazing_angle_is_left_out(head: FaceModel) -> None:
    from facestage_blender.synthetic.scans.face_region import face_vertices

    vertices = 1e3 * head.vertices + np.array([0, 0, -900.0])
    camera = Camera.default(256, 256, 500.0)
    corners = np.array([[0, 0], [256, 0], [256, 256], [0, 256]], float)
    found = face_vertices(vertices, head.triangles, camera, corners)
    outline = np.abs(vertices[found, 0]).max() / np.abs(vertices[:, 0]).max()
    # The cosine of what is left of a right angle, of an ellipse 75 wide and 95 deep.
    assert 0.9 < outline < 0.999


def test_skin_along_the_line_of_sight_is_left_out_where_nothing_hides_it() -> None:
    """A roof before the camera, one side at 70 degrees to the view, the other at 88."""
    from facestage_blender.synthetic.scans.face_region import face_vertices

    gentle, steep = (50.0 / np.tan(np.radians(angle)) for angle in (70.0, 88.0))
    x, y, z = np.array([-gentle, 0.0, steep]), 20.0, np.array([-50.0, 0.0, -50.0])
    vertices = np.array([[x[k], side * y, -900.0 + z[k]] for k in range(3) for side in (-1, 1)])
    triangles = np.array([[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]])
    camera = Camera.default(256, 256, 1000.0)
    corners = np.array([[0, 0], [256, 0], [256, 256], [0, 256]], float)
    assert face_vertices(vertices, triangles, camera, corners).tolist() == [0, 1, 2, 3]
