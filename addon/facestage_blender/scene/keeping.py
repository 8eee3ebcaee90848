"""What a saved .blend refers to is found again: beside the file, and relative to it.

While a file is unsaved, landmarks and results lie in Blender's temporary folder, which is emptied
when Blender is left. When it is saved they go beside it.
"""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import ClassVar

import bpy
from bpy.app.handlers import persistent

from facestage.contract.errors import InputError

from ..properties import OfPhoto
from .paths import absolute, work_folder_of

PATHS = ("photo", "landmarks", "result")
MADE_HERE = ("landmarks", "result")  # by the backend, where work_folder says


def register() -> None:
    """Look after the paths whenever a file is saved."""
    bpy.app.handlers.save_pre.append(_before)
    bpy.app.handlers.save_post.append(_after)


def unregister() -> None:
    """Undo :func:`register`."""
    bpy.app.handlers.save_post.remove(_after)
    bpy.app.handlers.save_pre.remove(_before)


@persistent
def _before(path: str, *_further: object) -> None:
    """Write the paths as the file at ``path`` is to have them."""
    if not path:  # the startup file
        return
    blend = Path(path)
    for scene in own_scenes():
        _keep_temporary(scene, blend)
    _Saving.paths = list(_paths())
    _point(blend.parent)


@persistent
def _after(*_arguments: object) -> None:
    """What is in memory belongs to the file that is open: another one if a copy was saved."""
    _point(Path(bpy.data.filepath).parent if bpy.data.filepath else None)
    _Saving.paths = []


def _below(path: Path, folder: Path) -> Path:
    """Where in ``folder`` a path is: faces and scenes have folders of their own there."""
    return path.relative_to(folder) if path.is_relative_to(folder) else Path(path.name)


class _Saving:
    """Where the scenes' paths lead while a file is written: scene, where its settings are (those of
    a photo, of a face), name there, path.
    """

    paths: ClassVar[list[tuple[str, str, str, Path]]] = []


def _point(folder: Path | None) -> None:
    """Write the paths relative to ``folder``, where the user wants relative paths and there is a
    way; without a folder, absolute.
    """
    relative = bpy.context.preferences.filepaths.use_relative_paths
    for scene, place, name, path in _Saving.paths:
        written = str(path)
        if folder is not None and relative:
            with suppress(ValueError):  # it is on another drive
                written = bpy.path.relpath(written, start=str(folder))
        setattr(bpy.data.scenes[scene].path_resolve(place), name, written)


def own_scenes() -> list[bpy.types.Scene]:
    """The scenes that this file may change: not those linked from others."""
    return [scene for scene in bpy.data.scenes if scene.library is None]


def _settings(scene: bpy.types.Scene) -> Iterator[tuple[str, OfPhoto]]:
    """All that the scene knows of photos, with where it is: of the photo and the face that are
    shown, and of the others.
    """
    settings = scene.facestage
    for place, face in (("", settings), *_listed("faces", settings.faces)):
        yield f"facestage{place}", face
        for inner, photo in _listed("photos", face.photos):
            yield f"facestage{place}{inner}", photo


def _listed(name: str, items: Iterable[OfPhoto]) -> Iterator[tuple[str, OfPhoto]]:
    for place, item in enumerate(items):
        yield f".{name}[{place}]", item


def _paths() -> Iterator[tuple[str, str, str, Path]]:
    """The scenes' names, where their settings are, the names of the paths in these, and where they
    lead.
    """
    for scene in own_scenes():
        for place, settings in _settings(scene):
            for name in PATHS:
                given = getattr(settings, name)
                if given:
                    with suppress(InputError):
                        yield scene.name, place, name, absolute(given)


def _keep_temporary(scene: bpy.types.Scene, blend: Path) -> None:
    """Copy what lies in Blender's temporary folder beside ``blend``, and mean the copy."""
    temporary = Path(bpy.app.tempdir).resolve()
    for owner, place, name, path in list(_paths()):
        if owner != scene.name or name not in MADE_HERE:
            continue
        if not path.is_relative_to(temporary) or not path.exists():
            continue
        target = work_folder_of(blend) / _below(path, temporary / "facestage")
        try:
            if path.is_dir():
                shutil.copytree(path, target, dirs_exist_ok=True)
            else:
                target.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, target)
        except OSError as error:
            bpy.context.window_manager.facestage.began = ""
            bpy.context.window_manager.facestage.failure = (
                f"'{path.name}' could not be kept beside the .blend ({error.strerror or error}) "
                "and will be gone when Blender is left; make room, and save again."
            )
            continue
        setattr(scene.path_resolve(place), name, str(target))
