"""Files and folders that the scene's settings name."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

import bpy

from facestage.contract.errors import InputError
from facestage.contract.files.paths import user_path

JOB_FOLDER, RESULT_FOLDER = "job", "result"  # in the work folder
CORRECTIONS = "corrections.json"  # there, too


def absolute(path: str) -> Path:
    """A path of the user interface, which may start with // for the .blend's folder.

    Raises InputError for what can be no path.
    """
    return user_path(bpy.path.abspath(path) or ".", "path").resolve()


def work_folder(scene: bpy.types.Scene) -> Path:
    """Where the scene's job and result go: as set, else beside the .blend, else Blender's temporary
    folder. Another face of the scene, or another scene whose files would lie in the same place, has
    a folder of its own in it.

    Raises InputError when what is set can be no path.
    """
    settings = scene.facestage
    if settings.output:
        whole = user_path(bpy.path.abspath(settings.output), "output folder").resolve()
    elif bpy.data.filepath:
        whole = work_folder_of(Path(bpy.data.filepath))
    else:
        whole = Path(bpy.app.tempdir) / "facestage"
    if settings.folder:
        return whole / settings.folder
    others = (each for each in bpy.data.scenes if each != scene)
    if any(_lie_in(whole.resolve(), each.facestage) for each in others):
        return whole / bpy.path.clean_name(scene.name)
    return whole


def _lie_in(folder: Path, settings: bpy.types.PropertyGroup) -> bool:
    """Whether another scene's files lie right in ``folder``."""
    for path in (settings.result, settings.landmarks):
        with suppress(InputError):
            if path and absolute(path).parent == folder:
                return True
    return False


def work_folder_of(blend: Path) -> Path:
    """Where the job and the result of a saved .blend go."""
    return blend.with_name(f"{blend.stem}_facestage")


def job_folders(folder: Path, photos: int) -> list[Path]:
    """Where the jobs of that many photos go; 0 or 1: the one job of the one photo."""
    if photos < 2:
        return [folder / JOB_FOLDER]
    return [folder / f"{JOB_FOLDER}_{number}" for number in range(1, photos + 1)]


def result_folder(scene: bpy.types.Scene, given: str = "") -> Path:
    """The folder given, else that of the scene's last fit.

    Raises InputError for what can be no path.
    """
    return absolute(given or scene.facestage.result or str(work_folder(scene) / RESULT_FOLDER))


def require_photo(scene: bpy.types.Scene) -> Path:
    """The photo's file. Raises InputError when none is chosen."""
    if not scene.facestage.photo:
        raise InputError("No photo is chosen; press Choose Photo first.")
    return absolute(scene.facestage.photo)
