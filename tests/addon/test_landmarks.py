"""Landmarks as empties: file, empties and pixels agree for any camera; dragging, marks, undo,
saving.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.landmarks import Landmarks
from reference.known import known

Numbers = tuple[float, float, float]
# Sensor fit, lens, shift, location, rotation and scale of a camera, and the photo's size.
VIEWS: dict[
    str, tuple[str, float, tuple[float, float], Numbers, Numbers, Numbers, tuple[int, int]]
] = {
    "plain": ("AUTO", 50.0, (0.0, 0.0), (0, -1, 0), (1.57, 0, 0), (1, 1, 1), (640, 480)),
    "portrait": ("AUTO", 85.0, (0.02, -0.03), (1, -2, 0.5), (1.2, 0.1, 0.4), (1, 1, 1), (480, 640)),
    "shifted": (
        "HORIZONTAL",
        30.0,
        (0.3, 0.2),
        (1, -2, 0.5),
        (1.2, 0.1, 0.4),
        (1, 1, 1),
        (480, 640),
    ),
    "vertical": (
        "VERTICAL",
        120.0,
        (-0.3, 0.1),
        (10, -200, 50),
        (0.3, 2.1, 0.4),
        (1, 1, 1),
        (4000, 3000),
    ),
    "scaled": ("AUTO", 50.0, (0.1, 0.1), (0, -1, 0), (1.57, 0.2, 0), (0.3, 2, 5), (640, 480)),
}


def made_up(width: int, height: int, scheme: str = "ibug68") -> Landmarks:
    rng = np.random.default_rng(4)
    count = {"ibug68": 68, "mediapipe478": 478}[scheme]
    points = rng.uniform(0.2, 0.7, (count, 2)) * [width, height]
    return Landmarks(scheme, points, rng.uniform(size=count) > 0.1)


def set_view(scene, name: str) -> tuple[int, int]:
    import bpy

    fit, lens, shift, location, rotation, scale, size = VIEWS[name]
    view = scene.camera or bpy.data.objects.new("view", bpy.data.cameras.new("view"))
    if scene.camera is None:
        scene.collection.objects.link(view)
        scene.camera = view
    data = view.data
    data.sensor_fit, data.lens, data.sensor_width, data.sensor_height = fit, lens, 36.0, 20.0
    data.shift_x, data.shift_y = shift
    view.location, view.rotation_euler, view.scale = location, rotation, scale
    scene.render.resolution_x, scene.render.resolution_y = size
    return size


def seen_pixels(scene) -> np.ndarray:
    """Where Blender itself shows the empties in the camera's picture, in the contract's pixels."""
    import bpy
    from bpy_extras.object_utils import world_to_camera_view

    from facestage_blender.landmarks.empties import landmark_empties

    bpy.context.view_layer.update()
    width, height = scene.render.resolution_x, scene.render.resolution_y
    empties = landmark_empties(scene)
    seen = [
        world_to_camera_view(scene, scene.camera, item.matrix_world.translation) for item in empties
    ]
    return np.array([[point.x * width, (1 - point.y) * height] for point in seen])


@pytest.mark.parametrize("name", sorted(VIEWS))
def test_empties_stand_on_their_pixels(scene, name: str) -> None:
    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )
    from facestage_blender.landmarks.plane import empty_pixel

    size = set_view(scene, name)
    given = made_up(*size)
    plane = show_landmarks(scene, given, *size)
    # Others need leave to run scripts.
    assert all(curve.driver.is_simple_expression for curve in plane.animation_data.drivers)
    read = np.array([empty_pixel(plane, item) for item in landmark_empties(scene)])
    off, exact = np.abs(seen_pixels(scene) - given.points).max(), np.abs(read - given.points).max()
    print(
        f"{name}: Blender shows them off by {off:.1e} px, read back off by {exact:.1e} of 1e-3 px"
    )
    assert exact < 1e-3
    # Blender places objects in the world in single precision: far from its origin that is coarser.
    assert off < (1e-2 if name != "vertical" else 2.0)
    again = edited_landmarks(scene)
    np.testing.assert_array_equal(again.points, given.points)
    np.testing.assert_array_equal(again.visible, given.visible)


@pytest.mark.parametrize("after", ["portrait", "shifted", "scaled"])
def test_landmarks_stay_on_the_photo_when_the_camera_changes(scene, after: str) -> None:
    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )

    size = set_view(scene, "plain")
    given = made_up(*size)
    show_landmarks(scene, given, *size)
    landmark_empties(scene)[30].location.x += 10 / 640
    set_view(scene, after)
    scene.render.resolution_x, scene.render.resolution_y = size
    moved = given.points.copy()
    moved[30, 0] += 10
    assert np.abs(seen_pixels(scene) - moved).max() < 1e-2
    assert np.abs(edited_landmarks(scene).points - moved).max() < 1e-3


@pytest.mark.parametrize("how", ["towards the camera", "unparented", "constrained", "hidden"])
def test_reading_is_what_the_camera_sees(scene, how: str) -> None:
    """Whatever a user does to a point, it counts where the camera's picture shows it."""
    import bpy

    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )

    size = set_view(scene, "portrait")
    given = made_up(*size)
    show_landmarks(scene, given, *size)
    bpy.context.view_layer.update()
    empty = landmark_empties(scene)[30]
    if how == "towards the camera":
        empty.location.z = 0.2
    elif how == "unparented":
        world = empty.matrix_world.copy()
        empty.parent = None
        empty.matrix_world = world
        empty.location.x += 0.003
    elif how == "constrained":
        empty.constraints.new("COPY_LOCATION").target = landmark_empties(scene)[31]
    else:
        empty.hide_set(True)
    expected = seen_pixels(scene)
    assert np.abs(edited_landmarks(scene).points - expected).max() < 1e-2


def test_followers_follow_what_is_dragged(scene) -> None:
    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )
    from facestage_blender.landmarks.scheme import handles

    size = set_view(scene, "plain")
    given = made_up(*size, "mediapipe478")
    show_landmarks(scene, given, *size)
    empties = landmark_empties(scene)
    assert len(empties) == len(handles("mediapipe478", 478)) < 80
    for empty in empties:
        empty.location.x += 12.5 / 640
        empty.location.y += 5 / 640
    np.testing.assert_allclose(
        edited_landmarks(scene).points, given.points + np.array([12.5, -5]), atol=1e-2
    )


def test_a_hidden_handle_hides_what_is_around_it(scene) -> None:
    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )

    size = set_view(scene, "plain")
    given = made_up(*size, "mediapipe478")
    show_landmarks(scene, given, *size)
    empties = landmark_empties(scene)
    handle = next(item for item in empties if item.facestage_landmark.state == "VISIBLE")
    looks = handle.empty_display_size
    handle.facestage_landmark.state = "HIDDEN"
    assert handle.empty_display_size < looks
    now = edited_landmarks(scene)
    np.testing.assert_array_equal(now.points, given.points)
    changed = np.flatnonzero(now.visible != given.visible)
    indices = np.array([item.facestage_landmark.index for item in empties])
    distance = np.linalg.norm(given.points[:, None] - given.points[indices], axis=2)
    nearest = indices[distance.argmin(axis=1)]
    np.testing.assert_array_equal(
        changed, np.flatnonzero((nearest == handle.facestage_landmark.index) & given.visible)
    )


def test_weights_of_a_file_are_kept(scene) -> None:
    from dataclasses import replace

    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )

    size = set_view(scene, "plain")
    given = replace(made_up(*size), weights=np.arange(68) / 10)
    show_landmarks(scene, given, *size)
    empties = landmark_empties(scene)
    assert [item.facestage_landmark.state for item in empties].count("IGNORED") == 1
    assert edited_landmarks(scene).to_json() == given.to_json()
    empties[0].facestage_landmark.state = "VISIBLE"
    empties[7].facestage_landmark.state = "IGNORED"
    expected = np.arange(68) / 10
    expected[[0, 7]] = 1, 0
    np.testing.assert_array_equal(known(edited_landmarks(scene).weights), expected)
    empties[7].facestage_landmark.state = "HIDDEN"
    now = edited_landmarks(scene)
    assert known(now.weights)[7] == 0.7 and not now.visible[7]


def test_a_landmark_without_position_waits_on_the_photo(scene) -> None:
    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )

    size = set_view(scene, "plain")
    given = made_up(*size)
    given.points[3], given.visible[3] = np.nan, False
    show_landmarks(scene, given, *size)
    assert np.isnan(edited_landmarks(scene).points[3]).all()
    empty = landmark_empties(scene)[3]
    empty.location, empty.facestage_landmark.state = (0.1, 0.1, 0), "VISIBLE"
    now = edited_landmarks(scene)
    np.testing.assert_allclose(now.points[3], [320 + 64, 240 - 64], atol=1e-3)
    assert now.visible[3]


@pytest.fixture
def ready(scene, stand_in, photo: Path, tmp_path: Path):
    import bpy

    stand_in("works")
    scene.facestage.output = str(tmp_path / "work")
    assert bpy.ops.facestage.choose_photo(filepath=str(photo)) == {"FINISHED"}
    return scene


def refused(operator: Callable[..., set[str]], match: str, **options: object) -> None:
    with pytest.raises(RuntimeError, match=match) as caught:
        operator(**options)
    assert "Traceback" not in str(caught.value)


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


@pytest.mark.parametrize("name", ["plain", "portrait", "scaled"])
def test_drawing_is_over_the_points(scene, name: str) -> None:
    """What is drawn over the camera's view lies where its picture has the landmarks."""
    import bpy

    from facestage_blender.landmarks.empties import landmark_empties, show_landmarks
    from facestage_blender.landmarks.overlay import (
        current_landmarks,
        discs_by_color,
        line_ends,
        on_screen,
    )

    width, height = size = set_view(scene, name)
    given = made_up(*size, "mediapipe478")
    show_landmarks(scene, given, *size)
    bpy.context.view_layer.update()
    window = scene.camera.calc_matrix_camera(
        bpy.context.evaluated_depsgraph_get(), x=width, y=height
    )
    view = np.array(window @ scene.camera.matrix_world.normalized().inverted())
    landmarks = current_landmarks(scene)
    assert landmarks is not None
    pixels = (on_screen(scene, landmarks, view) * [0.5, -0.5] + 0.5) * size
    np.testing.assert_allclose(pixels, given.points, atol=0.02)
    discs = discs_by_color(scene, landmarks, pixels, 1.0)
    counts = [len(triangles) // 24 for _, triangles in discs]
    states = [item.facestage_landmark.state for item in landmark_empties(scene)]
    assert counts == [478 - len(states), 0, states.count("VISIBLE"), states.count("HIDDEN"), 0]
    assert len(line_ends(landmarks, pixels)) == 2 * (16 + 4 + 4 + 3 + 4 + 6 + 6 + 12 + 8)
    # Behind the view nothing is drawn.
    turned = np.array(window @ scene.camera.matrix_world.normalized().inverted()) * [
        [1],
        [1],
        [1],
        [-1],
    ]
    assert not len(line_ends(landmarks, on_screen(scene, landmarks, turned)))
    landmark_empties(scene)[0].location.x += 0.1
    bpy.context.view_layer.update()
    assert current_landmarks(scene) is not landmarks


def test_handles_are_named_and_distinct() -> None:
    from facestage_blender.landmarks.scheme import IBUG_NAMES, handles, lines

    assert handles("ibug68", 68)[30].name == "Landmark 31 nose tip"
    assert len({handle.index for handle in handles("mediapipe478", 478)}) == len(IBUG_NAMES) + 5
    assert len(handles("another", 12)) == 12
    for scheme, count in (("ibug68", 68), ("mediapipe478", 478)):
        assert {index for line in lines(scheme) for index in line} <= {
            item.index for item in handles(scheme, count)
        }


def test_followers_move_smoothly() -> None:
    """One dragged handle takes its surroundings along and leaves the rest."""
    from facestage_blender.landmarks.scheme import follow

    rng = np.random.default_rng(0)
    axis = np.linspace(0, 100, 9)
    knots = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    near, far = rng.uniform(-3, 3, (50, 2)) + 50, rng.uniform(0, 20, (50, 2))
    points = np.concatenate([knots, near, far])
    centre = 40
    moved = knots.copy()
    moved[centre] += [4, -2]
    after = follow(points, np.arange(81), moved) - points
    np.testing.assert_array_equal(after[:81], moved - knots)
    assert np.abs(after[81:131] - [4, -2]).max() < 1.5
    assert np.abs(after[131:]).max() < 0.1
    # Handles on one point, as those of closed lids, and handles that cannot determine a plane.
    np.testing.assert_allclose(
        follow(
            np.array([[0.0, 0], [0, 0], [9, 0], [4, 5]]),
            np.arange(3),
            np.array([[1.0, 0], [1, 0], [10, 0]]),
        )[3],
        [5, 5],
        atol=1e-2,
    )


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
