"""Files and folders that the scene's settings name."""

from __future__ import annotations

from pathlib import Path

import bpy

from facestage.contract.errors import InputError
from facestage.contract.files.paths import user_path

JOB_FOLDER, RESULT_FOLDER = "job", "result"  # in the work folder


def absolute(path: str) -> Path:
    """A path of the user interface, which may start with // for the .blend's folder.

    Raises InputError for what can be no path.
    """
    return user_path(bpy.path.abspath(path) or ".", "path").resolve()


def work_folder(scene: bpy.types.Scene) -> Path:
    """Where the scene's job and result go: as set, else beside the .blend, else Blender's temporary
    folder.

    Raises InputError when what is set can be no path.
    """
    if scene.facestage.output:
        return user_path(bpy.path.abspath(scene.facestage.output), "output folder").resolve()
    if bpy.data.filepath:
        return work_folder_of(Path(bpy.data.filepath))
    return Path(bpy.app.tempdir) / "facestage"


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
