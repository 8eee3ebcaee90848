"""Camera, resolution and colors that the scene had before the photo: kept, and given back."""

from __future__ import annotations

import json

import bpy

from facestage.contract.errors import InputError

from .camera import CAMERA_NAME
from .stage import facestage_collection

# What a photo changes, by who has it.
KEPT = {
    "render": (
        "resolution_x",
        "resolution_y",
        "resolution_percentage",
        "pixel_aspect_x",
        "pixel_aspect_y",
        "use_border",
    ),
    "view_settings": ("view_transform", "look", "exposure", "gamma"),
}


def keep_view(scene: bpy.types.Scene) -> None:
    """Remember what the scene looks through, and let it look through a camera of the photo's: a
    copy of the user's, that moves with nothing.
    """
    settings, camera = scene.facestage, scene.camera
    if settings.view_before:
        return
    values = {
        owner: {name: getattr(getattr(scene, owner), name) for name in names}
        for owner, names in KEPT.items()
    }
    settings.view_before, settings.camera_before = json.dumps(values), camera
    own = settings.photo_camera
    if own is not None and own.name in scene.objects:
        scene.camera = own
    elif camera is not None and camera.type == "CAMERA":
        scene.camera = _copy(camera, facestage_collection(scene))


def can_give_view_back(scene: bpy.types.Scene) -> bool:
    """Whether the scene looks otherwise than before its photo."""
    return bool(scene.facestage.view_before)


def give_view_back(scene: bpy.types.Scene) -> None:
    """Let the scene look as before the photo, whose camera stays.

    Raises InputError when it does.
    """
    settings = scene.facestage
    if not settings.view_before:
        raise InputError("The scene has the camera that it had before the photo.")
    values, before = json.loads(settings.view_before), settings.camera_before
    settings.photo_camera = scene.camera
    for owner, names in KEPT.items():
        for name in names:
            if name in values.get(owner, {}):
                setattr(getattr(scene, owner), name, values[owner][name])
    if before is not None and before.name in scene.objects:
        scene.camera = before
    settings.view_before, settings.camera_before = "", None


def return_to_photo(scene: bpy.types.Scene) -> None:
    """Look through the photo's camera again, where the user's was given back."""
    own = scene.facestage.photo_camera
    there = own is not None and own.name in scene.objects and own != scene.camera
    if there and not scene.facestage.faces and not scene.facestage.view_before:
        keep_view(scene)


def _copy(camera: bpy.types.Object, collection: bpy.types.Collection) -> bpy.types.Object:
    own = camera.copy()
    own.data = camera.data.copy()
    own.name = own.data.name = CAMERA_NAME
    for item in (own, own.data):
        item.animation_data_clear()
    own.constraints.clear()
    own.parent = None
    collection.objects.link(own)
    own.matrix_world = camera.matrix_world
    return own
