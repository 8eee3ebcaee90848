"""The plane in front of the camera that is the photo, and where on it an object is seen.

It follows the camera by a constraint and its lens by drivers, so that what stands on it stays on
its pixel whatever becomes of the camera. On the plane the photo's longer side is 1, x points right,
y up, and its centre is the origin.
"""

from __future__ import annotations

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError

from ..scene.camera import camera_pose, read_camera

PLANE, SIZE, DEPTH = "Facestage Photo Plane", "facestage_photo_size", "facestage_depth"
PLANE_DEPTH = 0.3  # metres in front of the camera


def build_plane(
    collection: bpy.types.Collection, camera: bpy.types.Object, width: int, height: int
) -> bpy.types.Object:
    """A new plane in front of ``camera`` for a photo of ``width`` x ``height`` pixels."""
    plane = bpy.data.objects.new(PLANE, None)
    collection.objects.link(plane)
    plane.hide_viewport = True  # or Blender draws lines from it to its children
    plane[SIZE], plane[DEPTH] = (width, height), max(PLANE_DEPTH, 2 * camera.data.clip_start)
    _follow_camera(plane, camera, width, height)
    return plane


def put_on_plane(plane: bpy.types.Object, item: bpy.types.Object) -> None:
    """Make an object move on the plane only."""
    item.parent, item.matrix_parent_inverse = plane, Matrix()
    item.show_in_front = True
    item.lock_location[2] = True
    item.lock_rotation = item.lock_scale = (True, True, True)


def photo_size(plane: bpy.types.Object) -> tuple[int, int]:
    """Width and height in pixels of the photo that the landmarks belong to."""
    return int(plane[SIZE][0]), int(plane[SIZE][1])


def plane_camera(plane: bpy.types.Object) -> bpy.types.Object | None:
    """The camera that the plane stands in front of, None when it was deleted."""
    target = next((item.target for item in plane.constraints if item.type == "CHILD_OF"), None)
    return target if target is not None and target.type == "CAMERA" else None


def plane_matrix(plane: bpy.types.Object) -> np.ndarray:
    """(4, 4) the plane's coordinates to the world's, from the camera: Blender need not update what
    is hidden.
    """
    view = plane_camera(plane)
    if view is None:
        return np.array(plane.matrix_world, np.float64)
    local = np.eye(4)
    local[:3, 3], scale = _plane_in_camera(read_camera(view.data, *photo_size(plane)), plane[DEPTH])
    local[:3, :3] *= scale
    return camera_pose(view) @ local


def on_plane(pixels: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixels (m, 2) of a ``width`` x ``height`` photo in the plane's coordinates (m, 2)."""
    return (pixels - [0.5 * width, 0.5 * height]) * [1.0, -1.0] / max(width, height)


def empty_pixel(plane: bpy.types.Object, empty: bpy.types.Object) -> np.ndarray:
    """(2,) pixel of the photo on which the plane's camera sees an empty."""
    width, height = photo_size(plane)
    view = plane_camera(plane)
    if empty.parent == plane and not empty.constraints:
        # In double precision, and true for objects that Blender does not update because they are
        # hidden.
        u, v, w = np.array(empty.matrix_parent_inverse @ empty.matrix_basis, np.float64)[:3, 3]
        if w == 0 or view is None:
            return np.array(
                [0.5 * width + u * max(width, height), 0.5 * height - v * max(width, height)]
            )
        camera = read_camera(view.data, width, height)
        origin, scale = _plane_in_camera(camera, plane[DEPTH])
        point = origin + scale * np.array([u, v, w])
    elif view is None:
        raise InputError(
            f"The landmark '{empty.name}' is no longer on the photo; press Revert, or parent "
            "it again."
        )
    else:
        camera = read_camera(view.data, width, height)
        point = (
            np.linalg.inv(camera_pose(view)) @ np.array([*empty.matrix_world.translation, 1.0])
        )[:3]
    pixel = camera.project(point[None])[0]
    if not np.isfinite(pixel).all():
        raise InputError(
            f"The landmark '{empty.name}' is behind the camera; press Revert, or move it onto "
            "the photo."
        )
    return pixel


def _follow_camera(
    plane: bpy.types.Object, camera: bpy.types.Object, width: int, height: int
) -> None:
    """Hold the plane where the photo is: a constraint for the camera's pose, drivers for its
    lens.
    """
    hold = plane.constraints.new("CHILD_OF")
    hold.target = camera
    hold.use_scale_x = hold.use_scale_y = hold.use_scale_z = False  # as camera_pose
    hold.inverse_matrix = Matrix()
    longer, depth = max(width, height), plane[DEPTH]
    plane.location[2] = -depth
    for axis in range(3):
        # As read_camera: the focal length is lens * side / sensor with the side that the sensor is
        # fitted to.
        _drive(
            plane,
            "scale",
            axis,
            camera,
            f"{depth} / lens * (sensor_height * {longer / height!r} if sensor_fit > 1.5 else "
            f"sensor_width * ({longer / width!r} if sensor_fit > 0.5 else 1.0))",
            ("lens", "sensor_fit", "sensor_width", "sensor_height"),
        )
    for axis, shift in enumerate(("shift_x", "shift_y")):
        _drive(
            plane,
            "location",
            axis,
            camera,
            f"{depth} / lens * {shift} * (sensor_height if sensor_fit > 1.5 else sensor_width)",
            ("lens", "sensor_fit", "sensor_width", "sensor_height", shift),
        )


def _drive(
    plane: bpy.types.Object,
    channel: str,
    axis: int,
    camera: bpy.types.Object,
    expression: str,
    inputs: tuple[str, ...],
) -> None:
    """Drive a channel by properties of the camera's lens; plain arithmetic runs without leave to
    run scripts.
    """
    driver = plane.driver_add(channel, axis).driver
    driver.type, driver.expression = "SCRIPTED", expression
    for name in inputs:
        variable = driver.variables.new()
        variable.name = name
        target = variable.targets[0]
        target.id_type, target.id, target.data_path = "CAMERA", camera.data, name


def _plane_in_camera(camera: Camera, depth: float) -> tuple[np.ndarray, float]:
    """The plane's origin (3,) and the length of its unit, in the camera frame, in metres."""
    step = depth / camera.focal_px
    cx, cy = camera.principal_px
    origin = np.array([(0.5 * camera.width - cx) * step, (cy - 0.5 * camera.height) * step, -depth])
    return origin, max(camera.width, camera.height) * step
