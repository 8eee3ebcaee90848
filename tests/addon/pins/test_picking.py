"""The point of the surface at a pixel, and the photo's pixels on the screen."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage_blender.pins.picking import facing, surface_at
from facestage_blender.pins.screen import PhotoOnScreen
from reference.known import known

CAMERA = Camera(100, 80, 120.0, (52.0, 41.0))


def test_the_nearest_triangle_that_faces_the_camera_is_picked():
    """A slanted one, one behind it, and one before it that shows its back."""
    random = np.random.default_rng(0)
    slanted = np.array([[-0.3, -0.3, -1.5], [0.4, -0.3, -1.0], [0.0, 0.4, -2.0]])
    points = np.concatenate([slanted * 2, slanted, (slanted * 0.5)[::-1]])
    triangles = np.arange(9).reshape(3, 3)
    pixels = CAMERA.project(points)
    np.testing.assert_array_equal(facing(pixels, triangles), [True, True, False])
    for _ in range(20):
        inside = random.dirichlet(np.ones(3))
        point = inside @ slanted
        found = surface_at(CAMERA.project(point[None])[0], pixels, -points[:, 2], triangles)
        corners, weights = known(found)
        np.testing.assert_array_equal(corners, [3, 4, 5])
        np.testing.assert_allclose(weights, inside, atol=1e-9)
    assert surface_at(np.array([1.0, 1.0]), pixels, -points[:, 2], triangles) is None


@pytest.mark.parametrize("behind", [True, False])
def test_what_is_behind_the_camera_is_not_picked(behind: bool):
    points = np.array([[-1.0, -1.0, -1.0], [1.0, -1.0, -1.0], [0.0, 2.0, 1.0 if behind else -1.0]])
    found = surface_at(
        np.array([52.0, 41.0]), CAMERA.project(points), -points[:, 2], np.array([[0, 1, 2]])
    )
    assert (found is None) == behind


def test_photo_and_screen_lead_to_each_other():
    """Through a view that is zoomed and shifted, of a camera that stands anywhere."""
    pose = np.eye(4)
    pose[:3, :3] = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    pose[:3, :3] *= np.linalg.det(pose[:3, :3])
    pose[:3, 3] = 1.0, -2.0, 0.5
    projection = np.array([[2.2, 0, 0.3, 0], [0, 2.9, -0.2, 0], [0, 0, -1, -0.2], [0, 0, -1, 0.0]])
    perspective = projection @ np.linalg.inv(pose)
    screen = PhotoOnScreen.of(perspective, (900.0, 700.0), pose, CAMERA)
    point = np.array([[0.13, -0.2, -1.7]])
    seen = np.append(point, 1.0) @ pose.T @ perspective.T
    wanted = (0.5 + 0.5 * seen[:2] / seen[3]) * [900.0, 700.0]
    pixel = CAMERA.project(point)
    np.testing.assert_allclose(screen.to_region(pixel)[0], wanted, atol=1e-9)
    np.testing.assert_allclose(screen.to_photo(tuple(wanted)), pixel[0], atol=1e-9)
    one, other = (screen.to_region(step[None]) - screen.to_region(0 * pixel) for step in np.eye(2))
    assert screen.scale == pytest.approx(
        np.sqrt(np.linalg.norm(one) * np.linalg.norm(other)), rel=1e-9
    )
