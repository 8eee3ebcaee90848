"""Saved files find their photo, landmarks and result again."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture
def unsaved(scene, tmp_path: Path):
    """An unsaved scene whose landmarks and result lie in Blender's temporary folder."""
    import bpy

    from facestage_blender.scene.paths import work_folder

    folder = work_folder(scene)
    assert folder.is_relative_to(bpy.app.tempdir)
    (folder / "result").mkdir(parents=True, exist_ok=True)
    (folder / "result" / "result.json").write_text("fitted", encoding="utf-8")
    (folder / "points.json").write_text("points", encoding="utf-8")
    (tmp_path / "project").mkdir()
    photo = tmp_path / "project" / "photo.png"
    photo.write_bytes(b"photo")
    settings = scene.facestage
    settings.photo = str(photo)
    settings.landmarks, settings.result = str(folder / "points.json"), str(folder / "result")
    return scene


def contents(scene) -> tuple[str, str, str]:
    """What lies where the scene's paths lead."""
    from facestage_blender.scene.paths import absolute, require_photo, result_folder

    return (
        require_photo(scene).read_text(encoding="utf-8"),
        absolute(scene.facestage.landmarks).read_text(encoding="utf-8"),
        (result_folder(scene) / "result.json").read_text(encoding="utf-8"),
    )


FOUND = ("photo", "points", "fitted")


def test_a_result_of_an_unsaved_file_goes_beside_it_and_moves_with_it(
    unsaved, tmp_path: Path
) -> None:
    import bpy

    from facestage_blender.scene.paths import result_folder

    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "project" / "face.blend"))
    assert contents(unsaved) == FOUND
    assert result_folder(unsaved) == tmp_path / "project" / "face_facestage" / "result"
    (tmp_path / "project").rename(tmp_path / "moved")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "moved" / "face.blend"))
    assert contents(bpy.context.scene) == FOUND
    assert result_folder(bpy.context.scene).is_relative_to(tmp_path / "moved")


def test_saving_elsewhere_and_saving_a_copy_keep_every_path(unsaved, tmp_path: Path) -> None:
    import bpy

    first = tmp_path / "project" / "face.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(first))
    copy = tmp_path / "copies" / "deep" / "copy.blend"
    copy.parent.mkdir(parents=True)
    bpy.ops.wm.save_as_mainfile(filepath=str(copy), copy=True)
    assert bpy.data.filepath == str(first)
    assert contents(bpy.context.scene) == FOUND
    bpy.ops.wm.open_mainfile(filepath=str(copy))
    assert contents(bpy.context.scene) == FOUND
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "other.blend"))
    assert contents(bpy.context.scene) == FOUND


def test_who_wants_absolute_paths_keeps_them(unsaved, tmp_path: Path, monkeypatch) -> None:
    import bpy

    filepaths = bpy.context.preferences.filepaths
    before = filepaths.use_relative_paths
    try:
        filepaths.use_relative_paths = False
        bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "project" / "face.blend"))
        assert contents(unsaved) == FOUND
        assert Path(unsaved.facestage.photo).is_absolute()
    finally:
        filepaths.use_relative_paths = before


def test_a_full_disk_is_said_and_saving_goes_on(unsaved, tmp_path: Path, monkeypatch) -> None:
    import shutil

    import bpy

    def full(*_arguments: object, **_options: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(shutil, "copytree", full)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "project" / "face.blend"))
    assert "No space left" in bpy.context.window_manager.facestage.failure
    assert contents(unsaved) == FOUND
