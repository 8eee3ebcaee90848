"""Keys that were changed are found, fitted around, and what follows is keyed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from addon.exchange.films import FRAMES
from addon.ui.refusal import refused
from facestage.contract.corrections import read_corrections
from facestage.contract.sequence import Sequence

START = 101


@pytest.fixture
def imported(ready, sequence: Sequence):
    import bpy

    ready.frame_set(START)
    assert bpy.ops.facestage.import_performance(directory=str(sequence.folder)) == {"FINISHED"}
    return ready


def curve_of(scene, name: str):
    from facestage_blender.rig.face_rig import key_name
    from facestage_blender.rig.keyframes import curves_of
    from facestage_blender.rig.sliders import slider_path

    shapes = scene.facestage.rig.data.shape_keys
    path = slider_path(shapes.key_blocks[key_name(name)])
    return next(curve for curve in curves_of(shapes) if curve.data_path == path)


def values(scene, name: str) -> np.ndarray:
    return np.array([point.co.y for point in curve_of(scene, name).keyframe_points])


def found(scene):
    from facestage_blender.exchange.corrections import corrected_performance

    return corrected_performance(scene).corrections


def test_what_was_imported_is_not_corrected(imported, sequence: Sequence) -> None:
    import bpy

    refused(bpy.ops.facestage.refit_performance, "No key differs")


def test_a_key_that_was_moved_is_found(imported, sequence: Sequence) -> None:
    name = sequence.expression_names[1]
    curve_of(imported, name).keyframe_points[4].co.y = 1.25
    (only,) = found(imported)
    assert only.frame == sequence.frames[4].number == 9
    assert only.weights == {name: 1.25} and only.model_to_camera is None


def test_keys_that_were_deleted_say_nothing(imported, sequence: Sequence) -> None:
    import bpy

    curve = curve_of(imported, sequence.expression_names[1])
    for _ in range(3):
        curve.keyframe_points.remove(curve.keyframe_points[5])
    refused(bpy.ops.facestage.refit_performance, "No key differs")


@pytest.mark.parametrize("handles", [False, True])
def test_a_head_that_was_turned_is_found_as_a_pose(
    imported, sequence: Sequence, handles: bool
) -> None:
    import bpy
    from mathutils import Euler

    from facestage_blender.rig.sliders import carrier

    if handles:
        assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    head = carrier(imported.facestage.rig)
    imported.frame_set(START + 3)
    before = np.array(head.matrix_world)
    x, y, z = head.rotation_euler
    head.rotation_euler = Euler((x, y, z + 0.1))
    head.location.x += 0.01
    head.keyframe_insert("rotation_euler")
    head.keyframe_insert("location")
    bpy.context.view_layer.update()
    moved = np.array(head.matrix_world) @ np.linalg.inv(before)
    (only,) = found(imported)
    assert only.frame == sequence.frames[3].number and not only.weights
    camera = np.linalg.inv(np.array(imported.camera.matrix_world))
    wanted = camera @ moved @ np.linalg.inv(camera) @ sequence.model_to_camera[3]
    assert only.model_to_camera is not None
    np.testing.assert_allclose(only.model_to_camera, wanted, atol=2e-5)


@pytest.mark.parametrize("handles", [False, True])
def test_frames_beside_a_corrected_key_follow_and_the_key_stays(
    imported, sequence: Sequence, handles: bool, tmp_path: Path
) -> None:
    import bpy

    if handles:
        assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    name, other = sequence.expression_names[:2]
    before, beside = values(imported, name), values(imported, other)
    curve_of(imported, name).keyframe_points[4].co.y = 1.25
    imported.frame_set(START + 7)
    assert bpy.ops.facestage.refit_performance() == {"FINISHED"}
    after = values(imported, name)
    assert after[4] == 1.25
    # The stand-in lets those right beside it follow by half.
    np.testing.assert_allclose(after[[3, 5]] - before[[3, 5]], 0.5 * (1.25 - before[4]), atol=1e-6)
    rest = [*range(3), *range(6, FRAMES)]
    np.testing.assert_array_equal(after[rest], before[rest])
    np.testing.assert_array_equal(values(imported, other), beside)
    assert imported.frame_current == START + 7
    refused(bpy.ops.facestage.refit_performance, "No key differs")

    # What was corrected once is still known when more is.
    curve_of(imported, other).keyframe_points[8].co.y = 0.75
    assert bpy.ops.facestage.refit_performance(first=START + 6, last=START + 10) == {"FINISHED"}
    asked = tmp_path / "work" / "corrections.json"
    assert [each.frame for each in read_corrections(asked)] == [13]
    told = json.loads((Path(str(sequence.folder)) / "asked.json").read_text())
    assert told == {"film": sequence.film, "frames": "11:15"}
    assert [each.frame for each in Sequence.load(Path(str(sequence.folder))).corrected] == [9, 13]


def test_it_says_why_it_cannot(ready, sequence: Sequence, stand_in) -> None:
    import bpy

    refit = bpy.ops.facestage.refit_performance
    refused(refit, "No performance was imported")
    bpy.ops.facestage.import_performance(directory=str(sequence.folder))
    name = sequence.expression_names[0]
    curve_of(ready, name).keyframe_points[2].co.y = 1.25
    before = values(ready, name)
    refused(refit, "not from 900 to 950", first=900, last=950)
    stand_in("refuses")
    refused(refit, "of a cat")
    np.testing.assert_array_equal(values(ready, name), before)
    sequence.expression[0] += 0.5
    sequence.write_into(Path(str(sequence.folder)))
    refused(refit, "import it again")


def test_corrected_keys_of_simple_curves_stay_keys(ready, sequence: Sequence) -> None:
    import bpy

    ready.frame_set(START)
    folder = str(sequence.folder)
    assert bpy.ops.facestage.import_performance(directory=folder, simplify=1.0) == {"FINISHED"}
    name = sequence.expression_names[0]
    assert len(values(ready, name)) == 2
    key = curve_of(ready, name).keyframe_points.insert(START + 4, 0.9)
    assert key.co.y != pytest.approx(sequence.expression[4, 0], abs=1e-3)
    assert bpy.ops.facestage.refit_performance() == {"FINISHED"}
    points = {round(point.co.x): point.co.y for point in curve_of(ready, name).keyframe_points}
    assert points[START + 4] == pytest.approx(0.9, abs=1e-6)
    assert len(points) < FRAMES
    refused(bpy.ops.facestage.refit_performance, "No key differs")
