"""Landmarks as empties on the photo: made from a set of landmarks, dragged by the user, read back in pixels.

The empties stand on a plane in front of the camera that is the photo: it follows the camera by a constraint and its
lens by drivers, so that a landmark stays on its pixel whatever becomes of the camera. On the plane the photo's longer
side is 1, x points right, y up, and the photo's centre is the origin.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.landmarks import Landmarks
from facestage.contract.result import Result
from facestage.contract.storage import finite

from .camera import read_camera, require_camera
from .landmark_scheme import Handle, follow, handles, nearest_handle
from .stage import facestage_collection

FOUND = "landmarks.json"  # in a result's folder: the landmarks that were fitted
COLLECTION, PLANE = "Facestage Landmarks", "Facestage Photo Plane"
BASE, SIZE, DEPTH = "facestage_landmarks", "facestage_photo_size", "facestage_depth"
VISIBLE, HIDDEN, IGNORED = "VISIBLE", "HIDDEN", "IGNORED"
PLANE_DEPTH = 0.3  # metres in front of the camera
EMPTY_SHARE = 0.011  # size of an empty as a share of the face's
# A landmark that is closer to where it began than a 32-bit float can say was not moved.
UNMOVED_PX, UNMOVED_SHARE = 1e-3, 2e-7


def show_landmarks(scene: bpy.types.Scene, landmarks: Landmarks, width: int, height: int) -> bpy.types.Object:
    """Show the landmarks of a ``width`` x ``height`` photo as empties in place of those shown; returns their plane.

    Raises InputError when the scene has no perspective camera.
    """
    camera = require_camera(scene)
    remove_landmarks(scene)
    collection = bpy.data.collections.new(COLLECTION)
    facestage_collection(scene).children.link(collection)
    plane = bpy.data.objects.new(PLANE, None)
    collection.objects.link(plane)
    plane.hide_viewport = True  # or Blender draws lines from it to its children
    plane[BASE] = json.dumps(finite(landmarks.to_json()))
    plane[SIZE], plane[DEPTH] = (width, height), max(PLANE_DEPTH, 2 * camera.data.clip_start)
    _follow_camera(plane, camera, width, height)
    size = EMPTY_SHARE * float(np.ptp(landmarks.points[landmarks.counted], axis=0).max()) / max(width, height)
    for handle in handles(landmarks.scheme, len(landmarks.points)):
        empty = bpy.data.objects.new(handle.name, None)
        collection.objects.link(empty)
        empty.parent, empty.matrix_parent_inverse = plane, Matrix()
        empty.show_in_front = True
        empty.lock_location[2] = True
        empty.lock_rotation = empty.lock_scale = (True, True, True)
        mark = empty.facestage_landmark
        mark.index, mark.size = handle.index, size
    scene.facestage.landmark_plane = plane
    revert_landmarks(scene)
    for layer in scene.view_layers:
        layer.update()
    return plane


def shown_plane(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The plane that carries the landmarks' empties, or None when none are shown."""
    plane = scene.facestage.landmark_plane
    return plane if plane is not None and plane.name in scene.objects and BASE in plane else None


def require_plane(scene: bpy.types.Scene) -> bpy.types.Object:
    """The plane of the landmarks' empties. Raises InputError when none are shown."""
    plane = shown_plane(scene)
    if plane is None:
        raise InputError("No landmarks are shown; press Edit Landmarks first.")
    return plane


def landmark_empties(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The landmarks' empties in the order of the scheme, also those that the user gave another parent."""
    marked = [item for item in scene.objects if item.type == "EMPTY" and item.facestage_landmark.index >= 0]
    return sorted(marked, key=lambda item: (item.facestage_landmark.index, item.name))


def base_landmarks(plane: bpy.types.Object) -> Landmarks:
    """The landmarks that the empties were made from."""
    return Landmarks.from_json(json.loads(plane[BASE]), "set of landmarks in the scene")


def photo_size(plane: bpy.types.Object) -> tuple[int, int]:
    """Width and height in pixels of the photo that the landmarks belong to."""
    return int(plane[SIZE][0]), int(plane[SIZE][1])


def edited_landmarks(scene: bpy.types.Scene) -> Landmarks:
    """The landmarks as the empties show them: points (m, 2) in pixels, those without an empty following the others.

    An empty that was deleted is a landmark that is ignored. Raises InputError when an empty was duplicated, is behind
    the camera, or too few are left.
    """
    plane = require_plane(scene)
    base = base_landmarks(plane)
    width, height = photo_size(plane)
    editable = handles(base.scheme, len(base.points))
    indices = np.array([handle.index for handle in editable])
    empties = _by_index(landmark_empties(scene))
    unmoved = max(UNMOVED_PX, UNMOVED_SHARE * max(width, height))
    moved, states = base.points[indices].copy(), [IGNORED] * len(editable)
    for k, handle in enumerate(editable):
        if (empty := empties.get(handle.index)) is None:
            continue
        pixel = empty_pixel(plane, empty)
        if np.linalg.norm(pixel - _starts(base, editable, width, height)[k]) > unmoved:
            moved[k] = pixel
        states[k] = empty.facestage_landmark.state
    nearest = nearest_handle(base.points, indices)
    nearest[indices] = np.arange(len(indices))
    before = [_state(base, index) for index in range(len(base.points))]
    # Only what the user has changed at a handle spreads to the landmarks around it.
    now = [states[k] if states[k] != before[indices[k]] else before[index] for index, k in enumerate(nearest)]
    return with_states(base, follow(base.points, indices, moved), now)


def with_states(base: Landmarks, points: np.ndarray, states: list[str]) -> Landmarks:
    """The landmarks at ``points`` (m, 2) with a state each. Raises InputError when too few are left."""
    given = point_weights(base)
    weights = np.where(given > 0, given, 1.0)
    ignored = np.array([state == IGNORED for state in states])
    visible = np.array([state == VISIBLE for state in states]) | (ignored & base.visible)
    data: dict[str, Any] = {"scheme": base.scheme, "points": points.tolist(), "visible": visible.tolist()}
    if ignored.any() or (given != 1).any():
        data["weights"] = np.where(ignored, 0.0, weights).tolist()
    return Landmarks.from_json(data, "set of landmarks in the scene")


def revert_landmarks(scene: bpy.types.Scene) -> None:
    """Put every empty back to where it was made, as it was made."""
    plane = require_plane(scene)
    base = base_landmarks(plane)
    width, height = photo_size(plane)
    editable = handles(base.scheme, len(base.points))
    starts = on_plane(_starts(base, editable, width, height), width, height)
    empties = _by_index(landmark_empties(scene))
    for handle, start in zip(editable, starts, strict=True):
        if (empty := empties.get(handle.index)) is not None:
            empty.location = (*start, 0.0)
            empty.facestage_landmark.state = _state(base, handle.index)


def remove_landmarks(scene: bpy.types.Scene) -> None:
    """Take the empties and their plane out of the .blend."""
    plane = shown_plane(scene)
    scene.facestage.landmark_plane = None
    if plane is None:
        return
    collections = plane.users_collection
    for item in [*landmark_empties(scene), plane]:
        bpy.data.objects.remove(item)
    for collection in collections:
        if collection.name.split(".")[0] == COLLECTION and not collection.all_objects:
            bpy.data.collections.remove(collection)


def remember_landmarks(scene: bpy.types.Scene, result: Result) -> None:
    """Make the landmarks that a fit found by itself the scene's, so that they can be looked at and edited."""
    path = (result.folder or Path()) / FOUND
    if not scene.facestage.landmarks and shown_plane(scene) is None and path.is_file():
        scene.facestage.landmarks, scene.facestage.landmarks_from = str(path), "DETECTED"


def empty_pixel(plane: bpy.types.Object, empty: bpy.types.Object) -> np.ndarray:
    """(2,) pixel of the photo on which the plane's camera sees an empty."""
    width, height = photo_size(plane)
    view = plane_camera(plane)
    if empty.parent == plane and not empty.constraints:
        # In double precision, and true for objects that Blender does not update because they are hidden.
        u, v, w = np.array(empty.matrix_parent_inverse @ empty.matrix_basis, np.float64)[:3, 3]
        if w == 0 or view is None:
            return np.array([0.5 * width + u * max(width, height), 0.5 * height - v * max(width, height)])
        camera = read_camera(view.data, width, height)
        origin, scale = _plane_in_camera(camera, plane[DEPTH])
        point = origin + scale * np.array([u, v, w])
    elif view is None:
        raise InputError(f"The landmark '{empty.name}' is no longer on the photo; press Revert, or parent it again.")
    else:
        camera = read_camera(view.data, width, height)
        pose = np.array(view.matrix_world, np.float64)
        pose[:3, :3] /= np.linalg.norm(pose[:3, :3], axis=0)
        point = (np.linalg.inv(pose) @ np.array([*empty.matrix_world.translation, 1.0]))[:3]
    pixel = camera.project(point[None])[0]
    if not np.isfinite(pixel).all():
        raise InputError(f"The landmark '{empty.name}' is behind the camera; press Revert, or move it onto the photo.")
    return pixel


def on_plane(pixels: np.ndarray, width: int, height: int) -> np.ndarray:
    """Pixels (m, 2) of a ``width`` x ``height`` photo in the plane's coordinates (m, 2)."""
    return (pixels - [0.5 * width, 0.5 * height]) * [1.0, -1.0] / max(width, height)


def plane_camera(plane: bpy.types.Object) -> bpy.types.Object | None:
    """The camera that the plane stands in front of, None when it was deleted."""
    target = next((item.target for item in plane.constraints if item.type == "CHILD_OF"), None)
    return target if target is not None and target.type == "CAMERA" else None


def _follow_camera(plane: bpy.types.Object, camera: bpy.types.Object, width: int, height: int) -> None:
    """Hold the plane where the photo is: a constraint for the camera's pose, drivers for its lens."""
    hold = plane.constraints.new("CHILD_OF")
    hold.target = camera
    hold.use_scale_x = hold.use_scale_y = hold.use_scale_z = False  # a camera's scale does not change its picture
    hold.inverse_matrix = Matrix()
    longer, depth = max(width, height), plane[DEPTH]
    plane.location[2] = -depth
    for axis in range(3):
        # As read_camera: the focal length is lens * side / sensor with the side that the sensor is fitted to.
        _drive(
            plane, "scale", axis, camera,
            f"{depth} / lens * (sensor_height * {longer / height!r} if sensor_fit > 1.5 else "
            f"sensor_width * ({longer / width!r} if sensor_fit > 0.5 else 1.0))",
            ("lens", "sensor_fit", "sensor_width", "sensor_height"),
        )  # fmt: skip
    for axis, shift in enumerate(("shift_x", "shift_y")):
        _drive(
            plane, "location", axis, camera,
            f"{depth} / lens * {shift} * (sensor_height if sensor_fit > 1.5 else sensor_width)",
            ("lens", "sensor_fit", "sensor_width", "sensor_height", shift),
        )  # fmt: skip


def _drive(
    plane: bpy.types.Object,
    channel: str,
    axis: int,
    camera: bpy.types.Object,
    expression: str,
    inputs: tuple[str, ...],
) -> None:
    """Drive a channel by properties of the camera's lens; plain arithmetic runs without leave to run scripts."""
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


def _starts(base: Landmarks, editable: tuple[Handle, ...], width: int, height: int) -> np.ndarray:
    """(k, 2) where the handles' empties are made; those without a position wait along the photo's lower edge."""
    starts = base.points[[handle.index for handle in editable]].copy()
    lost = ~np.isfinite(starts).all(axis=1)
    starts[lost] = np.c_[np.linspace(0.05, 0.95, lost.sum()) * width, np.full(lost.sum(), 0.98 * height)]
    return starts


def _state(landmarks: Landmarks, index: int) -> str:
    if point_weights(landmarks)[index] == 0:
        return IGNORED
    return VISIBLE if landmarks.visible[index] else HIDDEN


def point_weights(landmarks: Landmarks) -> np.ndarray:
    """(m,) how much each landmark counts; 1 is as usual, 0 not at all."""
    return np.ones(len(landmarks.points)) if landmarks.weights is None else landmarks.weights


def _by_index(empties: list[bpy.types.Object]) -> dict[int, bpy.types.Object]:
    """Empties by their landmark's index. Raises InputError when two stand for one landmark."""
    found: dict[int, bpy.types.Object] = {}
    for empty in empties:
        other = found.setdefault(empty.facestage_landmark.index, empty)
        if other is not empty:
            raise InputError(f"'{other.name}' and '{empty.name}' are the same landmark; delete one of them.")
    return found
