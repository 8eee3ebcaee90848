"""The live relight preview: an image that follows the colors, powers and states of the stage's
lights.

While it is on, a handler looks for changes after Blender has updated the scene; a picture is made
only when the lights' radiance, or whether the result still describes the scene, is another than the
one shown. The image is never saved with the .blend and does not outlive the preview, whatever is
undone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, ClassVar

import bpy
import numpy as np
from bpy.app.handlers import persistent

from facestage.contract.errors import InputError

from ..scene.camera import photo_in_front, put_photo_in_front
from ..scene.paths import result_folder
from ..scene.stage import read_stage
from .relit_photo import RelitPhoto, changed_at

IMAGE, MARK = "Facestage Relit", "facestage_relit"
# Changes that come within this time, such as those of one drag of the mouse, make one picture.
DELAY_SECONDS = 0.02
REMEDY = "the preview cannot follow that; undo it, apply the result again, or render (F12)."


class Preview:
    """The one preview of this Blender; off while ``photo`` is None."""

    photo: ClassVar[RelitPhoto | None] = None
    scene: ClassVar[str] = ""
    # what the image shows: what is wrong, else which radiance
    shown: ClassVar[tuple[str, bytes] | None] = None


def start(scene: bpy.types.Scene) -> None:
    """Show the scene's last result under its present lights and follow them.

    Raises InputError without a cache.
    """
    photo = RelitPhoto.load(result_folder(scene), scene.facestage.photo)
    stop()
    Preview.photo, Preview.scene = photo, scene.name
    bpy.app.handlers.depsgraph_update_post.append(_on_change)
    refresh()


def stop() -> None:
    """Turn the preview off and take its image away."""
    if _on_change in bpy.app.handlers.depsgraph_update_post:
        bpy.app.handlers.depsgraph_update_post.remove(_on_change)
    if bpy.app.timers.is_registered(refresh):
        bpy.app.timers.unregister(refresh)
    Preview.photo, Preview.scene, Preview.shown = None, "", None
    remove_image()
    _say("")


def refresh() -> None:
    """Make the image show the scene's present lights; nothing to do when it does."""
    scene = bpy.data.scenes.get(Preview.scene)
    if Preview.photo is None or scene is None:
        stop()
        return
    trouble, radiance = "", None
    try:
        photo = Preview.photo = _current(scene, Preview.photo)
        if scene.facestage.stage is None:
            raise InputError("The light stage is gone")
        stage = read_stage(scene.facestage.stage)
        trouble, radiance = photo.difference(scene, stage), stage.radiance
        trouble = f"{trouble}: {REMEDY}" if trouble else ""
    except InputError as error:
        trouble, photo = str(error), Preview.photo
    wanted = (trouble, b"" if trouble or radiance is None else radiance.tobytes())
    image = find_image()
    if wanted == Preview.shown and image is not None:
        return
    # A picture of lights that are elsewhere would lie: then the photo is shown as it is.
    _show(scene, photo, photo.photo if trouble or radiance is None else photo.pixels(radiance))
    Preview.shown = wanted
    _say(trouble)


def show_before(camera: bpy.types.Object, before: bool) -> None:
    """Show the photo over what the camera sees, the preview included, or no more."""
    put_photo_in_front(camera, before)
    for background in camera.data.background_images:
        if background.image is not None and background.image.get(MARK):
            background.show_background_image = not before


def find_image() -> bpy.types.Image | None:
    """The preview's image, whatever it is called by now."""
    return next((image for image in bpy.data.images if image.get(MARK)), None)


def remove_image() -> None:
    """Take the preview's image out of the .blend and from behind every camera."""
    for camera in bpy.data.cameras:
        for background in list(camera.background_images):
            if background.image is not None and background.image.get(MARK):
                camera.background_images.remove(background)
                # Blender draws its evaluated copy of the camera, which would still have the image.
                camera.update_tag()
    for image in [image for image in bpy.data.images if image.get(MARK)]:
        bpy.data.images.remove(image)


def register() -> None:
    """Watch undo, files and saving: the image must not stay in a .blend, nor come back when the
    preview is off.
    """
    for events, handler in WATCHED:
        events().append(handler)


def unregister() -> None:
    """Undo :func:`register`; a preview that is on is turned off."""
    stop()
    for events, handler in WATCHED:
        events().remove(handler)


def _current(scene: bpy.types.Scene, photo: RelitPhoto) -> RelitPhoto:
    """The relit photo of the scene's result, read again when that is another one by now."""
    folder: Path = result_folder(scene)
    if folder == photo.result.folder and changed_at(folder) == photo.changed:
        return photo
    return RelitPhoto.load(folder, scene.facestage.photo)


def _show(scene: bpy.types.Scene, photo: RelitPhoto, pixels: np.ndarray) -> None:
    """Write pixels (h w, 4), linear, into the preview's image, in front of what the scene's camera
    sees.
    """
    image = find_image()
    if image is not None and tuple(image.size) != photo.size:
        remove_image()
        image = None
    if image is None:
        image = bpy.data.images.new(IMAGE, *photo.size, alpha=False, float_buffer=True)
        image[MARK] = True
    image.pixels.foreach_set(pixels.ravel())
    image.update()
    camera = scene.camera.data if scene.camera is not None else None
    if camera is not None and not any(
        background.image == image for background in camera.background_images
    ):
        background = camera.background_images.new()
        background.image, background.alpha, background.frame_method = image, 1.0, "FIT"
        background.display_depth = "FRONT"
        background.show_background_image = not photo_in_front(scene.camera)
        camera.show_background_images = True
    for window in bpy.data.window_managers[0].windows:
        for area in window.screen.areas:
            if area.type in {"VIEW_3D", "IMAGE_EDITOR"}:
                area.tag_redraw()


def _say(status: str) -> None:
    """Put into words, in the panel, what the preview does."""
    state = bpy.data.window_managers[0].facestage_preview
    state.active, state.status = Preview.photo is not None, status


def _soon() -> None:
    """Refresh after the changes that Blender is working on; without a window there are no timers:
    now.
    """
    if bpy.app.background:
        refresh()
    elif not bpy.app.timers.is_registered(refresh):
        bpy.app.timers.register(refresh, first_interval=DELAY_SECONDS)


def _on_change(scene: bpy.types.Scene, *_: Any) -> None:
    if scene.name == Preview.scene:
        _soon()


@persistent
def _after_undo(*_: Any) -> None:
    """An undo step may hold an image of another moment, or of a preview that is off by now."""
    if Preview.photo is None:
        remove_image()
        return
    Preview.shown = None
    _soon()


@persistent
def _before_save(*_: Any) -> None:
    remove_image()


@persistent
def _after_save(*_: Any) -> None:
    if Preview.photo is not None:
        _soon()


@persistent
def _around_load(*_: Any) -> None:
    stop()


WATCHED = (
    (lambda: bpy.app.handlers.undo_post, _after_undo),
    (lambda: bpy.app.handlers.redo_post, _after_undo),
    (lambda: bpy.app.handlers.save_pre, _before_save),
    (lambda: bpy.app.handlers.save_post, _after_save),
    (lambda: bpy.app.handlers.load_pre, _around_load),
    (lambda: bpy.app.handlers.load_post, _around_load),
)
