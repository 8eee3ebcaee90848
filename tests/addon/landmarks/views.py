"""Views of a photo and landmarks on it, for the tests."""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks

Numbers = tuple[float, float, float]
# Sensor fit, lens, shift, location, rotation and scale of a camera, and the photo's size.
VIEWS: dict[
    str, tuple[str, float, tuple[float, float], Numbers, Numbers, Numbers, tuple[int, int]]
] = {
    "plain": ("AUTO", 50.0, (0.0, 0.0), (0, -1, 0), (1.57, 0, 0), (1, 1, 1), (640, 480)),
    "portrait": ("AUTO", 85.0, (0.02, -0.03), (1, -2, 0.5), (1.2, 0.1, 0.4), (1, 1, 1), (480, 640)),
    "shifted": (
        "HORIZONTAL",
        30.0,
        (0.3, 0.2),
        (1, -2, 0.5),
        (1.2, 0.1, 0.4),
        (1, 1, 1),
        (480, 640),
    ),
    "vertical": (
        "VERTICAL",
        120.0,
        (-0.3, 0.1),
        (10, -200, 50),
        (0.3, 2.1, 0.4),
        (1, 1, 1),
        (4000, 3000),
    ),
    "scaled": ("AUTO", 50.0, (0.1, 0.1), (0, -1, 0), (1.57, 0.2, 0), (0.3, 2, 5), (640, 480)),
}


def made_up(width: int, height: int, scheme: str = "ibug68") -> Landmarks:
    rng = np.random.default_rng(4)
    count = {"ibug68": 68, "mediapipe478": 478}[scheme]
    points = rng.uniform(0.2, 0.7, (count, 2)) * [width, height]
    return Landmarks(scheme, points, rng.uniform(size=count) > 0.1)


def set_view(scene, name: str) -> tuple[int, int]:
    import bpy

    fit, lens, shift, location, rotation, scale, size = VIEWS[name]
    view = scene.camera or bpy.data.objects.new("view", bpy.data.cameras.new("view"))
    if scene.camera is None:
        scene.collection.objects.link(view)
        scene.camera = view
    data = view.data
    data.sensor_fit, data.lens, data.sensor_width, data.sensor_height = fit, lens, 36.0, 20.0
    data.shift_x, data.shift_y = shift
    view.location, view.rotation_euler, view.scale = location, rotation, scale
    scene.render.resolution_x, scene.render.resolution_y = size
    return size


def seen_pixels(scene) -> np.ndarray:
    """Where Blender itself shows the empties in the camera's picture, in the contract's pixels."""
    import bpy
    from bpy_extras.object_utils import world_to_camera_view

    from facestage_blender.landmarks.empties import landmark_empties

    bpy.context.view_layer.update()
    width, height = scene.render.resolution_x, scene.render.resolution_y
    empties = landmark_empties(scene)
    seen = [
        world_to_camera_view(scene, scene.camera, item.matrix_world.translation) for item in empties
    ]
    return np.array([[point.x * width, (1 - point.y) * height] for point in seen])
