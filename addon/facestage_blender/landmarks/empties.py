"""Landmarks as empties on the photo: made from a set of landmarks, dragged by the user, read back
in pixels.
"""

from __future__ import annotations

import json
from typing import Any

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.json_text import decode_json
from facestage.contract.files.storage import finite
from facestage.contract.landmarks import Landmarks

from ..scene.camera import put_photo_in_front, require_camera
from ..scene.stage import facestage_collection
from .plane import (
    DEPTH,
    SIZE,
    build_plane,
    empty_pixel,
    on_plane,
    photo_size,
    plane_camera,
    put_on_plane,
)
from .scheme import Handle, follow, handles, nearest_handle

COLLECTION, BASE = "Facestage Landmarks", "facestage_landmarks"
VISIBLE, HIDDEN, IGNORED = "VISIBLE", "HIDDEN", "IGNORED"
EMPTY_SHARE = 0.011  # size of an empty as a share of the face's
# A landmark that is closer to where it began than a 32-bit float can say was not moved.
UNMOVED_PX, UNMOVED_SHARE = 1e-3, 2e-7


def show_landmarks(
    scene: bpy.types.Scene, landmarks: Landmarks, width: int, height: int
) -> bpy.types.Object:
    """Show the landmarks of a ``width`` x ``height`` photo as empties in place of those shown;
    returns their plane.

    Raises InputError when the scene has no perspective camera.
    """
    camera = require_camera(scene)
    remove_landmarks(scene)
    collection = bpy.data.collections.new(COLLECTION)
    facestage_collection(scene).children.link(collection)
    plane = build_plane(collection, camera, width, height)
    plane[BASE] = json.dumps(finite(landmarks.to_json()))
    put_photo_in_front(camera, True)
    size = (
        EMPTY_SHARE
        * float(np.ptp(landmarks.points[landmarks.counted], axis=0).max())
        / max(width, height)
    )
    editable = handles(landmarks.scheme, len(landmarks.points))
    starts = on_plane(_starts(landmarks, editable, width, height), width, height)
    for handle, start in zip(editable, starts, strict=True):
        empty = bpy.data.objects.new(handle.name, None)
        collection.objects.link(empty)
        put_on_plane(plane, empty)
        empty.location = (*start, 0.0)
        mark = empty.facestage_landmark
        mark.index, mark.size, mark.state = handle.index, size, _state(landmarks, handle.index)
    scene.facestage.landmark_plane = plane
    for layer in scene.view_layers:
        layer.update()
    return plane


def shown_plane(scene: bpy.types.Scene) -> bpy.types.Object | None:
    """The plane that carries the landmarks' empties, or None when none are shown."""
    plane = scene.facestage.landmark_plane
    return (
        plane
        if plane is not None
        and plane.name in scene.objects
        and {BASE, SIZE, DEPTH} <= set(plane.keys())
        else None
    )


def require_plane(scene: bpy.types.Scene) -> bpy.types.Object:
    """The plane of the landmarks' empties. Raises InputError when none are shown."""
    plane = shown_plane(scene)
    if plane is None:
        raise InputError("No landmarks are shown; press Edit Landmarks first.")
    return plane


def landmark_empties(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """The landmarks' empties in the order of the scheme, also those that the user gave another
    parent.
    """
    marked = [
        item
        for item in scene.objects
        if item.type == "EMPTY" and item.facestage_landmark.index >= 0
    ]
    return sorted(marked, key=lambda item: (item.facestage_landmark.index, item.name))


def base_landmarks(plane: bpy.types.Object) -> Landmarks:
    """The landmarks that the empties were made from.

    Raises InputError when the scene does not hold them any more.
    """
    try:
        data = dict(decode_json(str(plane[BASE]).encode()))
    except (TypeError, ValueError) as error:
        raise InputError(
            "The landmarks in the scene are damaged; press Detect Landmarks again."
        ) from error
    return Landmarks.from_json(data, "set of landmarks in the scene")


def edited_landmarks(scene: bpy.types.Scene) -> Landmarks:
    """The landmarks as the empties show them: points (m, 2) in pixels, those without an empty
    following the others.

    An empty that was deleted is a landmark that is ignored. Raises InputError when an empty was
    duplicated, is behind the camera, or too few are left.
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
    now = [
        states[k] if states[k] != before[indices[k]] else before[index]
        for index, k in enumerate(nearest)
    ]
    return with_states(base, follow(base.points, indices, moved), now)


def with_states(base: Landmarks, points: np.ndarray, states: list[str]) -> Landmarks:
    """The landmarks at ``points`` (m, 2) with a state each.

    Raises InputError when too few are left.
    """
    given = point_weights(base)
    weights = np.where(given > 0, given, 1.0)
    ignored = np.array([state == IGNORED for state in states])
    visible = np.array([state == VISIBLE for state in states]) | (ignored & base.visible)
    data: dict[str, Any] = {
        "scheme": base.scheme,
        "points": points.tolist(),
        "visible": visible.tolist(),
    }
    if ignored.any() or (given != 1).any():
        data["weights"] = np.where(ignored, 0.0, weights).tolist()
    return Landmarks.from_json(data, "set of landmarks in the scene")


def remove_landmarks(scene: bpy.types.Scene) -> None:
    """Take the empties and their plane out of the .blend."""
    plane = shown_plane(scene)
    scene.facestage.landmark_plane = None
    items = landmark_empties(scene)  # also those whose plane was deleted
    collections = {collection for item in items for collection in item.users_collection}
    if plane is not None:
        collections |= set(plane.users_collection)
        if (camera := plane_camera(plane)) is not None:
            put_photo_in_front(camera, scene.facestage.pinning)
        items.append(plane)
    for item in items:
        bpy.data.objects.remove(item)
    for collection in collections:
        if collection.name.split(".")[0] == COLLECTION and not collection.all_objects:
            bpy.data.collections.remove(collection)


def _starts(base: Landmarks, editable: tuple[Handle, ...], width: int, height: int) -> np.ndarray:
    """(k, 2) where the handles' empties are made; those without a position wait along the photo's
    lower edge.
    """
    starts = base.points[[handle.index for handle in editable]].copy()
    lost = ~np.isfinite(starts).all(axis=1)
    starts[lost] = np.c_[
        np.linspace(0.05, 0.95, lost.sum()) * width, np.full(lost.sum(), 0.98 * height)
    ]
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
            raise InputError(
                f"'{other.name}' and '{empty.name}' are the same landmark; delete one of them."
            )
    return found
