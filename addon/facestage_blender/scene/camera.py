"""Blender's camera and the contract's pinhole camera, exactly, with principal point and any sensor
fit.
"""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError

from ..pictures.images import load_image

SENSOR_MM = 36.0
CAMERA_NAME = "Facestage Camera"


def require_camera(scene: bpy.types.Scene) -> bpy.types.Object:
    """The scene's camera. Raises InputError when there is none or it has no perspective."""
    if scene.camera is None:
        raise InputError("The scene has no camera; choose a photo first, or add a camera.")
    if scene.camera.data.type != "PERSP":
        raise InputError(
            f"The camera '{scene.camera.name}' is not a perspective camera; set its type to "
            "Perspective."
        )
    return scene.camera


def camera_pose(camera: bpy.types.Object) -> np.ndarray:
    """(4, 4) camera frame to world; a camera's scale does not change its picture."""
    pose = np.array(camera.matrix_world, np.float64)
    pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
    return pose


def read_camera(data: bpy.types.Camera, width: int, height: int) -> Camera:
    """The contract's camera of a Blender camera for a picture of ``width`` x ``height`` pixels."""
    horizontal = data.sensor_fit == "HORIZONTAL" or (data.sensor_fit == "AUTO" and width >= height)
    # Shift and sensor are measured along the side that the sensor is fitted to.
    side = width if horizontal else height
    sensor = data.sensor_height if data.sensor_fit == "VERTICAL" else data.sensor_width
    return Camera(
        width,
        height,
        focal_px=data.lens * side / sensor,
        principal_px=(width / 2 - data.shift_x * side, height / 2 + data.shift_y * side),
    )


def write_camera(scene: bpy.types.Scene, data: bpy.types.Camera, camera: Camera) -> None:
    """Give a Blender camera the lens of ``camera``, and the scene its size in pixels."""
    data.type, data.sensor_fit, data.sensor_width = "PERSP", "HORIZONTAL", SENSOR_MM
    data.lens = camera.focal_px * SENSOR_MM / camera.width
    data.shift_x = (camera.width / 2 - camera.principal_px[0]) / camera.width
    data.shift_y = (camera.principal_px[1] - camera.height / 2) / camera.width
    set_resolution(scene, camera.width, camera.height)


def set_resolution(scene: bpy.types.Scene, width: int, height: int) -> None:
    """Render the whole picture at ``width`` x ``height`` square pixels."""
    render = scene.render
    render.resolution_x, render.resolution_y, render.resolution_percentage = width, height, 100
    render.pixel_aspect_x = render.pixel_aspect_y = 1.0
    render.use_border = False


def ensure_camera(scene: bpy.types.Scene, collection: bpy.types.Collection) -> bpy.types.Object:
    """The scene's camera, or a new one in front of the stage's origin."""
    if scene.camera is None:
        scene.camera = bpy.data.objects.new(CAMERA_NAME, bpy.data.cameras.new(CAMERA_NAME))
        collection.objects.link(scene.camera)
        scene.camera.location = (0.0, -1.0, 0.0)
        scene.camera.rotation_euler = (1.5707963, 0.0, 0.0)
    scene.camera.data.clip_start = min(scene.camera.data.clip_start, 0.01)
    return scene.camera


def show_photo(scene: bpy.types.Scene, camera: bpy.types.Object, path: Path) -> bpy.types.Image:
    """Show the photo behind the camera's view and take over its size.

    Raises InputError when it is no image.
    """
    image = load_image(path)
    image.alpha_mode = "NONE"  # alpha only masks the fit; the user sees the whole photo
    set_resolution(scene, *image.size)
    show_as_photos_are(scene)
    data = camera.data
    data.show_background_images = True
    background = next(iter(data.background_images), None) or data.background_images.new()
    background.image, background.alpha, background.frame_method = image, 1.0, "FIT"
    background.display_depth = "FRONT" if scene.facestage.pinning else "BACK"
    return image


def photo_in_front(camera: bpy.types.Object) -> bool:
    """Whether the photo covers what the camera sees."""
    background = next(iter(camera.data.background_images), None)
    return background is not None and background.display_depth == "FRONT"


def put_photo_in_front(camera: bpy.types.Object, front: bool) -> None:
    """Show the photo over what the camera sees, or behind it."""
    background = next(iter(camera.data.background_images), None)
    if background is not None:
        background.display_depth = "FRONT" if front else "BACK"
        camera.data.update_tag()


def show_as_photos_are(scene: bpy.types.Scene) -> None:
    """Show renders without a tone curve: the fit explains the photo's own values."""
    view = scene.view_settings
    view.view_transform = "Standard"
    view.look, view.exposure, view.gamma = "None", 0.0, 1.0
