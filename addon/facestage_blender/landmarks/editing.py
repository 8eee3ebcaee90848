"""The landmarks of the scene's photo: chosen or found, shown to be edited, kept, forgotten."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import bpy

from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file
from facestage.contract.files.storage import write_json
from facestage.contract.landmarks import Landmarks
from facestage.contract.result import Result
from facestage.contract.result_files import LANDMARKS

from ..pictures.images import load_image
from ..properties import OfPhoto
from ..scene.paths import absolute, require_photo, work_folder
from .empties import (
    base_landmarks,
    edited_landmarks,
    landmark_empties,
    remove_landmarks,
    require_plane,
    show_landmarks,
    shown_plane,
)
from .plane import photo_size

DETECTED, EDITED = "landmarks_detected", "landmarks_edited"


def choose_landmarks(scene: bpy.types.Scene, path: Path) -> None:
    """Make ``path`` the photo's landmark file. Raises InputError when it is not one."""
    path = absolute(str(path))
    Landmarks.read(path)
    forget_landmarks(scene)
    scene.facestage.landmarks = str(path)


def forget_landmarks(scene: bpy.types.Scene) -> None:
    """Leave the landmarks of the photo to the backend."""
    remove_landmarks(scene)
    scene.facestage.landmarks = ""
    scene.facestage.property_unset("landmarks_from")


def edit_landmarks(scene: bpy.types.Scene) -> None:
    """Show the landmarks of the scene's file on its photo.

    Raises InputError when there are none.
    """
    if not scene.facestage.landmarks:
        raise InputError(
            "There are no landmarks to edit; press Detect Landmarks, or choose a landmark file."
        )
    width, height = load_image(require_photo(scene)).size
    remove_landmarks(scene)
    landmarks = read_landmarks(scene, width, height)
    assert landmarks is not None  # the scene names a file
    show_landmarks(scene, landmarks, width, height)


def keep_landmarks(scene: bpy.types.Scene) -> None:
    """Write the landmarks as the empties show them, unless nothing was changed, and take the
    empties away.

    A file that was there is left alone, so that undo leads back to what it held.
    """
    plane = require_plane(scene)
    landmarks = read_landmarks(scene, *photo_size(plane))
    assert landmarks is not None  # they are shown
    if landmarks.to_json() != base_landmarks(plane).to_json():
        path = free_path(work_folder(scene), EDITED)
        write_json(path, landmarks.to_json())
        scene.facestage.landmarks, scene.facestage.landmarks_from = str(path), "EDITED"
    remove_landmarks(scene)


def mark_landmarks(scene: bpy.types.Scene, selected: list[bpy.types.Object], state: str) -> None:
    """Set the state of the landmarks among the selected objects.

    Raises InputError when there is none.
    """
    empties = [item for item in landmark_empties(scene) if item in selected]
    if not empties:
        raise InputError("No landmark is selected; click one of the points on the photo first.")
    for empty in empties:
        empty.facestage_landmark.state = state


def free_path(folder: Path, stem: str) -> Path:
    """The first of STEM.json, STEM_2.json, ... in ``folder`` that is not there yet."""
    path, number = folder / f"{stem}.json", 2
    while path.exists():
        path, number = folder / f"{stem}_{number}.json", number + 1
    return path


def read_landmarks(scene: bpy.types.Scene, width: int, height: int) -> Landmarks | None:
    """The landmarks of the ``width`` x ``height`` photo: the empties' while they are shown, else
    the file's, else None.

    Raises InputError when they are not of this photo.
    """
    plane = shown_plane(scene)
    if plane is not None:
        if photo_size(plane) != (width, height):
            raise InputError(
                f"The landmarks shown are of a photo of {photo_size(plane)[0]} x "
                f"{photo_size(plane)[1]} pixels, the photo has {width} x {height}; press Done, "
                "then Detect Landmarks again."
            )
        landmarks = edited_landmarks(scene)
        landmarks.check_inside(width, height)
        return landmarks
    return file_landmarks(scene.facestage.landmarks, width, height)


def file_landmarks(path: str, width: int, height: int) -> Landmarks | None:
    """The landmarks in the file that settings name; None where they name none.

    Raises InputError when they are not of a photo of ``width`` x ``height`` pixels.
    """
    if not path:
        return None
    landmarks = Landmarks.read(absolute(path))
    landmarks.check_inside(width, height)
    return landmarks


def remember_landmarks(scene: bpy.types.Scene, result: Result) -> None:
    """Make the landmarks that a fit found by itself the scene's, so that they can be looked at and
    edited.
    """
    if shown_plane(scene) is None:
        take_landmarks(scene.facestage, result)


def take_landmarks(settings: OfPhoto, result: Result) -> None:
    """Make the landmarks that a fit found by itself those of its photo, unless it has some."""
    path = (result.folder or Path()) / LANDMARKS
    if settings.landmarks or not is_file(path):
        return
    with suppress(InputError):  # the result is none the worse without them
        Landmarks.read(path)
        settings.landmarks, settings.landmarks_from = str(path), "DETECTED"
