"""Landmarks by the operators: found, edited and kept; marks, undo, saving and what is said."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from addon.landmarks.views import seen_pixels
from addon.ui.refusal import refused
from facestage.contract.landmarks import Landmarks
from reference.known import known


@pytest.fixture
def ready(scene, stand_in, photo: Path, tmp_path: Path):
    import bpy

    stand_in("works")
    scene.facestage.output = str(tmp_path / "work")
    assert bpy.ops.facestage.choose_photo(filepath=str(photo)) == {"FINISHED"}
    return scene


def test_detect_edit_done(ready, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.landmarks.editing import read_landmarks
    from facestage_blender.landmarks.empties import landmark_empties

    ready.facestage.face_number = 3
    assert bpy.ops.facestage.detect_landmarks() == {"FINISHED"}
    detected = Landmarks.read(tmp_path / "work" / "landmarks_detected.json")
    np.testing.assert_array_equal(known(read_landmarks(ready, 96, 80)).points, detected.points)
    assert bpy.ops.facestage.done_landmarks() == {"FINISHED"}
    assert ready.facestage.landmarks_from == "DETECTED"  # nothing was changed
    assert bpy.ops.facestage.edit_landmarks() == {"FINISHED"}
    tip = bpy.data.objects["Landmark 4 nose tip"]
    tip.location.x += 3 / 96
    assert bpy.ops.facestage.done_landmarks() == {"FINISHED"}
    assert not landmark_empties(ready)
    assert ready.facestage.landmarks_from == "EDITED"
    kept = Landmarks.read(Path(ready.facestage.landmarks))
    np.testing.assert_allclose(kept.points[4], detected.points[4] + [3, 0], atol=1e-3)
    assert np.abs(kept.points - detected.points).max() < 6
    np.testing.assert_array_equal(
        Landmarks.read(tmp_path / "work" / "landmarks_detected.json").points, detected.points
    )


def test_fit_takes_the_points_as_they_are(ready, landmark_file: Path, tmp_path: Path) -> None:
    import bpy

    from facestage.contract.job import Job
    from facestage_blender.landmarks.empties import landmark_empties

    for answer in (
        bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file)),
        bpy.ops.facestage.build_stage(),
        bpy.ops.facestage.build_rig(),
        bpy.ops.facestage.edit_landmarks(),
    ):
        assert answer == {"FINISHED"}
    landmark_empties(ready)[30].location = (0, 0, 0)
    assert bpy.ops.facestage.fit() == {"FINISHED"}
    given, taken = (
        Landmarks.read(landmark_file),
        known(Job.load(tmp_path / "work" / "job").landmarks),
    )
    np.testing.assert_allclose(taken.points[30], [48, 40], atol=1e-3)
    np.testing.assert_allclose(
        np.delete(taken.points, 30, 0), np.delete(given.points, 30, 0), atol=1e-9
    )
    # The result has another lens and another place of the camera; the points are still where they
    # were.
    assert np.abs(seen_pixels(ready) - taken.points).max() < 1e-2


def test_marks_and_revert(ready, landmark_file: Path) -> None:
    import bpy

    from facestage_blender.landmarks.empties import edited_landmarks, landmark_empties

    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    assert bpy.ops.facestage.edit_landmarks() == {"FINISHED"}
    refused(bpy.ops.facestage.landmark_state, "No landmark is selected", state="HIDDEN")
    given = edited_landmarks(ready)
    empties = landmark_empties(ready)
    for empty in empties[:3]:
        empty.select_set(True)
    assert bpy.ops.facestage.landmark_state(state="HIDDEN") == {"FINISHED"}
    empties[5].location.x += 0.1
    bpy.data.objects.remove(empties[60])
    now = edited_landmarks(ready)
    assert now.weights is not None
    np.testing.assert_array_equal(np.flatnonzero(~now.visible), [0, 1, 2])
    np.testing.assert_array_equal(np.flatnonzero(now.weights == 0), [60])  # deleted is ignored
    np.testing.assert_array_equal(now.points[60], given.points[60])
    assert bpy.ops.facestage.revert_landmarks() == {"FINISHED"}
    assert len(landmark_empties(ready)) == 68
    assert edited_landmarks(ready).to_json() == given.to_json()


def test_users_errors_are_one_sentence(
    scene, stand_in, photo: Path, tmp_path: Path, monkeypatch
) -> None:
    import bpy

    stand_in("works")
    scene.facestage.output = str(tmp_path / "work")
    refused(bpy.ops.facestage.detect_landmarks, "Choose Photo")
    refused(bpy.ops.facestage.edit_landmarks, "Detect Landmarks")
    refused(bpy.ops.facestage.done_landmarks, "No landmarks are shown")
    refused(bpy.ops.facestage.revert_landmarks, "No landmarks are shown")
    bpy.ops.facestage.choose_photo(filepath=str(photo))
    stand_in("sees no face")
    refused(bpy.ops.facestage.detect_landmarks, "No face was found")
    assert scene.facestage.landmarks == ""
    assert "No face" in bpy.context.window_manager.facestage.failure
    monkeypatch.setenv("FACESTAGE_BACKEND", "/no/such/program")
    refused(bpy.ops.facestage.detect_landmarks, "/no/such/program")
    stand_in("works")
    scene.facestage.landmarks = str(tmp_path / "absent.json")
    refused(bpy.ops.facestage.edit_landmarks, "does not exist")


def test_what_cannot_be_read_says_so(ready, landmark_file: Path) -> None:
    import bpy

    from facestage_blender.landmarks.empties import landmark_empties

    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    bpy.ops.facestage.edit_landmarks()
    empties = landmark_empties(ready)
    empties[2].location.z = 50.0
    refused(bpy.ops.facestage.done_landmarks, "behind the camera")
    bpy.ops.facestage.revert_landmarks()
    copy = landmark_empties(ready)[7].copy()
    ready.collection.objects.link(copy)
    refused(bpy.ops.facestage.done_landmarks, "the same landmark")
    bpy.ops.facestage.revert_landmarks()
    for empty in landmark_empties(ready)[5:40]:
        empty.facestage_landmark.state = "HIDDEN"
    for empty in landmark_empties(ready)[40:]:
        empty.facestage_landmark.state = "IGNORED"
    refused(bpy.ops.facestage.done_landmarks, "at least 6")


def test_a_deleted_camera_keeps_the_landmarks(ready, landmark_file: Path) -> None:
    import bpy

    from facestage_blender.landmarks.empties import edited_landmarks

    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    bpy.ops.facestage.edit_landmarks()
    bpy.data.objects.remove(ready.camera)
    np.testing.assert_array_equal(
        edited_landmarks(ready).points, Landmarks.read(landmark_file).points
    )


def test_a_damaged_scene_is_said_and_mended(ready, landmark_file: Path) -> None:
    import bpy

    from facestage_blender.landmarks.empties import BASE, landmark_empties

    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    bpy.ops.facestage.edit_landmarks()
    for damage in ("{", "[1]", '{"scheme": 3}', 5):
        ready.facestage.landmark_plane[BASE] = damage
        refused(bpy.ops.facestage.done_landmarks, "damaged|scheme is 3")
    bpy.data.objects.remove(ready.facestage.landmark_plane)
    refused(bpy.ops.facestage.done_landmarks, "No landmarks are shown")
    assert bpy.ops.facestage.edit_landmarks() == {"FINISHED"}
    assert len(landmark_empties(ready)) == 68
    assert bpy.ops.facestage.done_landmarks() == {"FINISHED"}
    assert not landmark_empties(ready)


def test_another_photo_has_other_landmarks(ready, landmark_file: Path, tmp_path: Path) -> None:
    import bpy
    import cv2

    from facestage_blender.landmarks.empties import landmark_empties

    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    bpy.ops.facestage.edit_landmarks()
    other = tmp_path / "other.png"
    assert cv2.imwrite(str(other), np.full((50, 60, 3), 90, np.uint8))
    assert bpy.ops.facestage.choose_photo(filepath=str(other)) == {"FINISHED"}
    assert ready.facestage.landmarks == ""
    assert not landmark_empties(ready)


def test_undo_is_one_step_and_leaves_nothing_behind(ready, landmark_file: Path) -> None:
    import bpy

    from facestage_blender.landmarks.empties import COLLECTION, landmark_empties

    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    bpy.ops.ed.undo_push(message="before")
    before = {item.name for item in bpy.data.objects}
    bpy.ops.facestage.edit_landmarks()
    # what Blender does after an operator that the user starts
    bpy.ops.ed.undo_push(message="Edit Landmarks")
    bpy.data.objects["Landmark 31 nose tip"].location.x += 0.1
    moved = bpy.data.objects["Landmark 31 nose tip"].location.x
    bpy.context.view_layer.objects.active = bpy.data.objects["Landmark 31 nose tip"]
    bpy.ops.ed.undo_push(message="Move")
    assert bpy.ops.facestage.done_landmarks() == {"FINISHED"}
    bpy.ops.ed.undo_push(message="Done")
    assert {item.name for item in bpy.data.objects} == before
    assert COLLECTION not in bpy.data.collections
    edited = bpy.context.scene.facestage.landmarks
    assert edited != str(landmark_file)
    bpy.ops.ed.undo()
    assert bpy.context.scene.facestage.landmarks == str(landmark_file)
    assert bpy.data.objects["Landmark 31 nose tip"].location.x == moved
    bpy.ops.ed.undo()
    bpy.ops.ed.undo()
    assert not landmark_empties(bpy.context.scene)
    assert {item.name for item in bpy.data.objects} == before
    assert COLLECTION not in bpy.data.collections


def test_a_saved_scene_goes_on(ready, landmark_file: Path, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.landmarks.empties import edited_landmarks

    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    bpy.ops.facestage.edit_landmarks()
    bpy.data.objects["Landmark 31 nose tip"].location.x += 0.1
    expected = edited_landmarks(ready)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"), check_existing=False)
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    scene = bpy.context.scene
    np.testing.assert_array_equal(edited_landmarks(scene).points, expected.points)
    scene.camera.data.lens = 70
    assert np.abs(seen_pixels(scene) - expected.points).max() < 1e-2
    assert bpy.ops.facestage.done_landmarks() == {"FINISHED"}
    kept = json.loads(Path(scene.facestage.landmarks).read_text(encoding="utf-8"))
    np.testing.assert_array_equal(kept["points"], expected.points)


@pytest.mark.parametrize("operator", ["edit_landmarks", "detect_landmarks"])
def test_editing_shows_the_photo_in_object_mode(ready, landmark_file: Path, operator: str) -> None:
    import bpy

    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    bpy.ops.facestage.build_rig()
    bpy.context.view_layer.objects.active = ready.facestage.rig
    bpy.ops.object.mode_set(mode="SCULPT")
    assert getattr(bpy.ops.facestage, operator)() == {"FINISHED"}
    assert bpy.context.mode == "OBJECT"
    assert ready.camera.data.background_images[0].display_depth == "FRONT"
    views = [
        area.spaces.active for area in bpy.context.window.screen.areas if area.type == "VIEW_3D"
    ]
    assert views
    assert all(view.region_3d.view_perspective == "CAMERA" for view in views)
    bpy.ops.facestage.done_landmarks()
    assert ready.camera.data.background_images[0].display_depth == "BACK"


def test_the_panel_says_where_landmarks_come_from(ready, landmark_file: Path) -> None:
    import bpy

    from facestage_blender.ui.photo import landmark_lines

    settings = ready.facestage
    assert landmark_lines(settings) == ["Landmarks: found automatically"]
    bpy.ops.facestage.detect_landmarks()
    assert landmark_lines(settings) == ["478 points, found automatically", "10 hidden or ignored"]
    bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file))
    assert landmark_lines(settings) == ["68 points, from the file"]
    bpy.ops.facestage.edit_landmarks()
    bpy.data.objects["Landmark 31 nose tip"].facestage_landmark.state = "HIDDEN"
    bpy.ops.facestage.done_landmarks()
    assert landmark_lines(settings) == ["68 points, edited by hand", "1 hidden or ignored"]
    landmark_file.unlink()
    settings.landmarks = str(landmark_file)
    assert landmark_lines(settings) == ["The landmark file cannot be read"]
    bpy.ops.facestage.forget_landmarks()
    assert landmark_lines(settings) == ["Landmarks: found automatically"]
