"""Blender's camera shows each point on the pixel where the contract's camera has it."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError

CAMERAS = [
    Camera(256, 256, 600.0, (128.0, 128.0)),
    Camera(640, 400, 900.0, (301.5, 222.25)),
    Camera(300, 500, 450.0, (160.0, 190.0)),
]


@pytest.fixture
def view(scene):
    import bpy

    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    scene.camera.location, scene.camera.rotation_euler = (1, -2, 0.5), (1.2, 0.1, 0.4)
    return scene.camera


def blender_pixels(scene, view, points: np.ndarray) -> np.ndarray:
    """Where Blender shows camera-frame points (m, 3), in the contract's pixels."""
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    scene.view_layers[0].update()
    width, height = scene.render.resolution_x, scene.render.resolution_y
    seen = [
        world_to_camera_view(scene, view, view.matrix_world @ Vector(point)) for point in points
    ]
    return np.array([[point.x * width, (1 - point.y) * height] for point in seen])


@pytest.mark.parametrize("camera", CAMERAS)
def test_projection_is_the_same(scene, view, camera: Camera) -> None:
    from facestage_blender.scene.camera import write_camera

    points = np.random.default_rng(0).uniform((-0.1, -0.1, -1.5), (0.1, 0.1, -0.5), (50, 3))
    write_camera(scene, view.data, camera)
    error = np.abs(blender_pixels(scene, view, points) - camera.project(points)).max()
    print(f"off by {error:.2e} of 1e-3 pixels")
    assert error < 1e-3


@pytest.mark.parametrize("camera", CAMERAS)
def test_camera_survives_the_scene(scene, view, camera: Camera) -> None:
    from facestage_blender.scene.camera import read_camera, write_camera

    write_camera(scene, view.data, camera)
    found = read_camera(view.data, camera.width, camera.height)
    assert found.focal_px == pytest.approx(camera.focal_px, rel=1e-6)
    assert found.principal_px == pytest.approx(camera.principal_px, abs=1e-3)


@pytest.mark.parametrize("fit", ["AUTO", "HORIZONTAL", "VERTICAL"])
@pytest.mark.parametrize(("width", "height"), [(640, 400), (300, 500)])
def test_any_users_camera_is_read_right(scene, view, fit: str, width: int, height: int) -> None:
    from facestage_blender.scene.camera import read_camera, set_resolution

    data = view.data
    data.sensor_fit, data.sensor_width, data.sensor_height = fit, 30.0, 20.0
    data.lens, data.shift_x, data.shift_y = 45.0, 0.07, -0.11
    set_resolution(scene, width, height)
    points = np.random.default_rng(0).uniform((-0.1, -0.1, -1.5), (0.1, 0.1, -0.5), (20, 3))
    found = read_camera(data, width, height).project(points)
    np.testing.assert_allclose(found, blender_pixels(scene, view, points), atol=1e-3)


def test_rendered_pixels_are_where_the_projection_says(scene, view) -> None:
    """A small bright disc must be rendered with its centre on the projected pixel: no half-pixel
    shift.
    """
    import bpy
    from mathutils import Vector

    from facestage_blender.pictures.render import render_linear
    from facestage_blender.scene.camera import write_camera

    camera = CAMERAS[1].scaled(0.25)
    write_camera(scene, view.data, camera)
    scene.view_layers[0].update()
    point = np.array([0.05, 0.03, -1.0])
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.02, location=view.matrix_world @ Vector(point))
    coverage = render_linear(scene, 64, direct_only=True)[..., 3]
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    centre = np.array([(coverage * x).sum(), (coverage * y).sum()]) / coverage.sum()
    np.testing.assert_allclose(centre, camera.project(point[None])[0], atol=0.05)


def test_photo_is_shown_and_sets_the_size(scene, photo) -> None:
    from facestage_blender.exchange.photos import choose_photo

    choose_photo(scene, photo)
    assert (scene.render.resolution_x, scene.render.resolution_y) == (96, 80)
    assert scene.camera.data.background_images[0].image.size[:] == (96, 80)
    assert scene.facestage.photo == str(photo)
    assert scene.view_settings.view_transform == "Standard"


@pytest.mark.parametrize("content", [b"", b"hello, this is no picture"])
def test_what_is_no_picture_is_refused(scene, tmp_path, content: bytes) -> None:
    from facestage_blender.pictures.images import load_image

    bad = tmp_path / "photo.png"
    bad.write_bytes(content)
    with pytest.raises(InputError, match=r"photo\.png"):
        load_image(bad)
    with pytest.raises(InputError, match="does not exist"):
        load_image(tmp_path / "absent.png")


def test_what_is_no_perspective_camera_is_refused(scene, view) -> None:
    from facestage_blender.scene.camera import require_camera

    view.data.type = "ORTHO"
    with pytest.raises(InputError, match="perspective"):
        require_camera(scene)
    scene.camera = None
    with pytest.raises(InputError, match="no camera"):
        require_camera(scene)
