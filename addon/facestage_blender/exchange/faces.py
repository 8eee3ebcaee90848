"""The faces of a scene: added, shown in turn, taken away.

The scene's settings are of the face that is shown, with its photos, stage, rig and result. Where
there are several, a list holds all of them; what it says of the one that is shown is brought up to
date when another one comes to be shown.
"""

from __future__ import annotations

from typing import Any

import bpy

from facestage.contract.errors import InputError

from ..landmarks.editing import keep_landmarks
from ..landmarks.empties import shown_plane
from ..pictures.images import load_image
from ..properties import OfFace, PhotoSettings, StoredFace
from ..rig.control.control_rig import remove_control_rig
from ..scene.camera import show_photo
from ..scene.paths import absolute
from ..scene.several import separate_light
from ..scene.softbox import remove_softbox
from ..scene.stage import stage_lights
from ..skin.brows import remove_brows
from ..skin.lashes import remove_lashes
from ..skin.wet_eyes import dry_eyes
from .asset import clear_asset

# What a face has made for itself, and what another one therefore begins without.
_MADE = (
    *("stage", "rig", "landmark_plane", "landmarks", "result", "folder"),
    *("photos", "photo_number", "pins", "pinning", "skin_tone", "skin_angle"),
    *("performance", "performance_start", "performance_mark"),
)


def add_face(scene: bpy.types.Scene) -> int:
    """Begin another face, in the same photo until another one is chosen; returns its number.

    Raises InputError while the one that is shown has no rig yet.
    """
    settings = scene.facestage
    if settings.rig is None or settings.stage is None:
        raise InputError("Build the rig of this face first; then add another one.")
    if not settings.faces:
        settings.faces.add()
        settings.face_shown = 1
    _store(scene)
    folders = {face.folder for face in settings.faces}
    fresh = settings.faces.add()
    _copy(settings, fresh, [name for name in _names(OfFace) if name not in _MADE])
    fresh.folder = next(
        name for name in (f"face_{n}" for n in range(2, len(folders) + 3)) if name not in folders
    )
    fresh.camera, fresh.face_number = scene.camera, settings.face_number + 1
    _take(scene, len(settings.faces))
    separate_light(scene)
    return len(settings.faces)


def show_face(scene: bpy.types.Scene, number: int) -> None:
    """Make another face the one that the panel is about, with its photo and its camera.

    Raises InputError where there is no such face, or its photo cannot be read.
    """
    face = _numbered(scene, number)
    if face.photo and number != scene.facestage.face_shown:
        load_image(absolute(face.photo))  # before anything changes
    if shown_plane(scene) is not None:
        keep_landmarks(scene)
    _store(scene)
    _take(scene, number)


def remove_face(scene: bpy.types.Scene, number: int) -> None:
    """Take a face out of the scene, with its rig, unless it is the user's own mesh, and its stage.
    The files stay.

    Raises InputError where there is no such face.
    """
    settings = scene.facestage
    _numbered(scene, number)
    show_face(scene, number)
    rig, stage = settings.rig, settings.stage
    if rig is not None and rig.name in scene.objects:
        clear_asset(rig)
        if rig.facestage_face.control_rig is not None:
            remove_control_rig(scene)
        remove_lashes(rig)
        remove_brows(rig)
        dry_eyes(rig)
        if not rig.facestage_face.own_mesh:
            _delete(rig)
    if stage is not None:
        remove_softbox(stage)
        for item in (*stage_lights(stage), stage):
            _delete(item)
    _take(scene, number + 1 if number < len(settings.faces) else number - 1)
    settings.faces.remove(number - 1)
    if settings.face_shown > number:
        settings.face_shown -= 1
    if len(settings.faces) == 1:
        settings.faces.clear()
        settings.face_shown = 1
    separate_light(scene)


def face_name(face: OfFace, number: int) -> str:
    """What the list calls a face: its rig's name, or its number."""
    return str(face.rig.name) if face.rig is not None else f"Face {number}"


def _numbered(scene: bpy.types.Scene, number: int) -> StoredFace:
    listed = scene.facestage.faces
    if not 1 <= number <= len(listed):
        raise InputError(
            f"There is no face {number}; the scene has {max(len(listed), 1)}: press Add Face."
        )
    return listed[number - 1]


def _store(scene: bpy.types.Scene) -> None:
    """Bring the list up to date with the face that is shown."""
    settings = scene.facestage
    if settings.faces:
        face = _numbered(scene, settings.face_shown)
        _copy(settings, face, _names(OfFace))
        face.camera = scene.camera


def _take(scene: bpy.types.Scene, number: int) -> None:
    settings, face = scene.facestage, _numbered(scene, number)
    _copy(face, settings, _names(OfFace))
    settings.face_shown = number
    if face.camera is not None and face.camera.name in scene.objects:
        scene.camera = face.camera
        if settings.photo:
            show_photo(scene, scene.camera, absolute(settings.photo))


def _names(group: type) -> list[str]:
    """The names of a group's settings, its bases' among them."""
    return [
        name for each in reversed(group.__mro__) for name in getattr(each, "__annotations__", ())
    ]


def _copy(giver: Any, taker: Any, names: list[str]) -> None:
    for name in names:
        if name != "photos":
            setattr(taker, name, getattr(giver, name))
            continue
        taker.photos.clear()
        for photo in giver.photos:
            _copy(photo, taker.photos.add(), _names(PhotoSettings))


def _delete(item: bpy.types.Object) -> None:
    """Remove an object with what only it uses."""
    data = item.data
    bpy.data.objects.remove(item)
    if isinstance(data, bpy.types.Mesh) and not data.users:
        bpy.data.meshes.remove(data)
    elif isinstance(data, bpy.types.Light) and not data.users:
        bpy.data.lights.remove(data)
