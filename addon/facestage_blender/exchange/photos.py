"""The photos of the person: chosen, added, shown in turn, taken away.

The scene's settings, its camera's lens and what is behind the camera are of the photo that is
shown. Where there are several, a list holds all of them; what it says of the one that is shown is
brought up to date when it is asked for.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy

from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file
from facestage.contract.person import FILE as PERSON
from facestage.contract.person import PHOTOS_MAX, Person
from facestage.contract.result import CONVERGED, Result

from ..landmarks.editing import forget_landmarks, keep_landmarks, remember_landmarks, take_landmarks
from ..landmarks.empties import shown_plane
from ..pictures.images import load_image
from ..properties import FROM_PHOTO, OfPhoto, PhotoSettings
from ..scene.camera import ensure_camera, show_photo
from ..scene.own_view import keep_view, return_to_photo
from ..scene.paths import absolute
from ..scene.several import other_faces
from ..scene.stage import facestage_collection

LENS = ("lens", "sensor_width", "sensor_height", "sensor_fit", "shift_x", "shift_y")


def choose_photo(scene: bpy.types.Scene, path: Path) -> None:
    """Make ``path`` the photo that is shown, in place of the one that was.

    Raises InputError when it is no picture.
    """
    path, settings = absolute(str(path)), scene.facestage
    return_to_photo(scene)
    if any(
        face.camera == scene.camera and face.photo and absolute(face.photo) != path
        for face in other_faces(scene)
    ):
        load_image(path)
        scene.camera = None  # it is another face's
        settings.known_lens = False
    elif not settings.photo and not (settings.known_lens or settings.keep_camera):
        load_image(path)
        keep_view(scene)
    show_photo(scene, ensure_camera(scene, facestage_collection(scene)), path)
    if settings.photo and absolute(settings.photo) != path:
        forget_landmarks(scene)  # they are of the photo before, as is its light
        settings.white_balance_known = False
        settings.skin_tone = FROM_PHOTO  # it may show somebody else
    settings.photo = str(path)


def add_photos(scene: bpy.types.Scene, paths: Sequence[Path]) -> None:
    """Add photos of the same person, and show the first of them.

    Raises InputError when one is no picture, or they would be too many; then none is added.
    """
    settings = scene.facestage
    paths = [absolute(str(path)) for path in paths]
    there = {absolute(photo.photo) for photo in stored_photos(scene) or [settings] if photo.photo}
    new = [path for path in dict.fromkeys(paths) if path not in there]
    if not new:
        raise InputError("These photos are there already; choose others of the same person.")
    if len(there) + len(new) > PHOTOS_MAX:
        raise InputError(
            f"{len(there) + len(new)} photos are too many; a person is fitted to {PHOTOS_MAX} at "
            "most: choose those that differ most in view and light."
        )
    for path in new:
        load_image(path)
    if not settings.photo:
        choose_photo(scene, new.pop(0))
    if not new:
        return
    if not settings.photos:
        settings.photos.add()
        settings.photo_number = 1
    stored_photos(scene)
    first = len(settings.photos) + 1
    for path in new:
        photo = settings.photos.add()
        photo.photo = str(path)
        _copy(scene.camera.data, photo, LENS)  # most people have one camera
        photo.known_lens = settings.known_lens
    show(scene, first)


def show(scene: bpy.types.Scene, number: int) -> None:
    """Show photo ``number``, with its landmarks and its lens; what was changed of the one before is
    kept.

    Raises InputError when there is no such photo, or it cannot be read.
    """
    settings = scene.facestage
    photo = numbered(scene, number)
    path = absolute(photo.photo)
    load_image(path)
    if shown_plane(scene) is not None:
        keep_landmarks(scene)
    stored_photos(scene)
    settings.photo_number = number
    _copy(photo, settings, tuple(OfPhoto.__annotations__))
    return_to_photo(scene)
    camera = ensure_camera(scene, facestage_collection(scene))
    _copy(photo, camera.data, LENS)
    show_photo(scene, camera, path)


def remove(scene: bpy.types.Scene, number: int) -> None:
    """Take a photo out of the list; where it is shown, its neighbour is shown instead.

    Raises InputError when there is no such photo, or the neighbour cannot be read.
    """
    settings = scene.facestage
    numbered(scene, number)
    if number == settings.photo_number:
        show(scene, number + 1 if number < len(settings.photos) else number - 1)
    settings.photos.remove(number - 1)
    if settings.photo_number > number:
        settings.photo_number -= 1
    if len(settings.photos) == 1:
        settings.photos.clear()
        settings.photo_number = 1


def take_results(scene: bpy.types.Scene, folder: Path, fitted: Sequence[Path]) -> Result | Person:
    """Make what a fit wrote into ``folder`` the result of its photo, or of each of its photos;
    ``fitted``: these, in their order. The list may have changed since the fit began.

    Raises InputError where that is no whole result.
    """
    settings = scene.facestage
    if not is_file(folder / PERSON):
        result = Result.load(folder)
        settings.result = str(folder)
        remember_landmarks(scene, result)
        return result
    person = Person.load(folder)
    of_photo = dict(zip(fitted, person.photos, strict=False))
    # Before any is changed.
    results = {path: Result.load(folder / each.folder) for path, each in of_photo.items()}
    for number, photo in enumerate(stored_photos(scene), 1):
        path = absolute(photo.photo)
        if path not in results:
            continue
        photo.result = str(results[path].folder)
        photo.advice = of_photo[path].advice
        photo.doubtful = of_photo[path].status != CONVERGED
        if number == settings.photo_number:
            settings.result = photo.result
            remember_landmarks(scene, results[path])
        else:
            take_landmarks(photo, results[path])
    return person


def numbered(scene: bpy.types.Scene, number: int) -> PhotoSettings:
    """Photo ``number`` of the list. Raises InputError when there is none."""
    listed = scene.facestage.photos
    if not 1 <= number <= len(listed):
        raise InputError(
            f"There is no photo {number}; the person has {max(len(listed), 1)}: press Add Photos."
        )
    return listed[number - 1]


def stored_photos(scene: bpy.types.Scene) -> list[PhotoSettings]:
    """All photos of the list as they are now; empty where there is but one photo."""
    settings = scene.facestage
    if settings.photos:
        photo = numbered(scene, settings.photo_number)
        _copy(settings, photo, tuple(OfPhoto.__annotations__))
        if scene.camera is not None and scene.camera.type == "CAMERA":
            _copy(scene.camera.data, photo, LENS)
    return list(settings.photos)


def _copy(giver: object, taker: object, names: Sequence[str]) -> None:
    for name in names:
        setattr(taker, name, getattr(giver, name))
