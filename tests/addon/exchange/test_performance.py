"""A tracked film becomes an animation: every frame's vertices are where the film's were."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from addon.exchange.films import FRAMES, RATE, WIDTH
from addon.ui.refusal import refused
from facestage.contract.sequence import KEYFRAMES, Sequence


def in_camera(scene) -> np.ndarray:
    """(n, 3) the rig's vertices as they are shown, in the camera's frame."""
    import bpy

    graph = bpy.context.evaluated_depsgraph_get()
    shown = scene.facestage.rig.evaluated_get(graph)
    flat = np.empty(3 * len(shown.data.vertices), np.float32)
    shown.data.vertices.foreach_get("co", flat)
    camera = np.linalg.inv(np.array(scene.camera.evaluated_get(graph).matrix_world))
    matrix = camera @ np.array(shown.matrix_world)
    return flat.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("handles", ["none", "before", "after", "baked", "gone"])
def test_every_frame_is_where_the_film_has_it(
    ready, sequence: Sequence, head, handles: str
) -> None:
    import bpy

    from facestage.contract.person import Person
    from facestage.contract.result import Result

    ready.frame_set(101)
    if handles in ("before", "gone"):
        assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    assert bpy.ops.facestage.import_performance(directory=str(sequence.folder)) == {"FINISHED"}
    if handles in ("after", "baked"):
        assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    if handles == "baked":
        assert bpy.ops.facestage.bake_to_rig() == {"FINISHED"}
    if handles == "gone":
        assert bpy.ops.facestage.remove_control_rig() == {"FINISHED"}
    assert ready.render.fps / ready.render.fps_base == pytest.approx(RATE)
    assert ready.frame_current == 101 and ready.frame_end == 250
    folder = Path(str(sequence.folder)) / KEYFRAMES
    person = Result.load(folder / Person.load(folder).photos[0].folder)
    for place in range(FRAMES):
        ready.frame_set(101 + place)
        wanted = head.shape(person.identity, sequence.expression[place])
        pose = sequence.model_to_camera[place]
        wanted = wanted @ pose[:3, :3].T + pose[:3, 3]
        assert np.abs(in_camera(ready) - wanted).max() < 2e-5, place


def test_light_that_changes_is_keyed(ready, sequence: Sequence) -> None:
    import bpy

    from facestage.contract.person import Person
    from facestage.contract.result import Result
    from facestage_blender.scene.stage import read_stage, require_stage

    folder = Path(str(sequence.folder))
    person = folder / KEYFRAMES
    lights = len(Result.load(person / Person.load(person).photos[0].folder).stage)
    radiance = np.random.default_rng(1).uniform(0.1, 2, (FRAMES, lights, 3))
    radiance[:, 0] = 0.0
    replace(sequence, light_radiance=radiance).write_into(folder)
    ready.frame_set(101)
    assert bpy.ops.facestage.import_performance(directory=str(folder)) == {"FINISHED"}
    for place in range(FRAMES):
        ready.frame_set(101 + place)
        np.testing.assert_allclose(
            read_stage(require_stage(ready)).radiance, radiance[place], rtol=1e-5
        )

    replace(sequence, light_radiance=radiance[:, 1:]).write_into(folder)
    again = bpy.ops.facestage.import_performance
    refused(again, f"is of {lights - 1} lights", directory=str(folder))


def test_between_frames_the_head_turns_the_short_way(ready, sequence: Sequence) -> None:
    import bpy

    bpy.ops.facestage.import_performance(directory=str(sequence.folder))
    first, rig, turns = ready.frame_current, ready.facestage.rig, []
    for half in range(2 * FRAMES - 1):
        ready.frame_set(first + half // 2, subframe=0.5 * (half % 2))
        turns.append(np.array(rig.rotation_euler))
    assert np.abs(np.diff(turns, axis=0)).max() < 0.6 * 4 * np.pi / (FRAMES - 1)


def test_the_film_plays_behind_the_camera(ready, sequence: Sequence, film: Path) -> None:
    import bpy

    ready.frame_set(11)
    bpy.ops.facestage.import_performance(directory=str(sequence.folder))
    background = ready.camera.data.background_images[0]
    assert background.image.source == "SEQUENCE"
    assert Path(background.image.filepath).name == "0005.png"
    user = background.image_user
    assert (user.frame_start, user.frame_duration, user.frame_offset) == (11, FRAMES, 4)
    assert ready.render.resolution_x == WIDTH


def test_another_models_rig_is_left_alone(ready, sequence: Sequence, tmp_path: Path) -> None:
    import bpy

    other = tmp_path / "other"
    other.mkdir()
    replace(sequence, model="ict:somewhere").write_into(other)
    fps = ready.render.fps
    refused(bpy.ops.facestage.import_performance, "build the rig", directory=str(other))
    refused(bpy.ops.facestage.import_performance, "facestage track", directory=str(tmp_path / "no"))
    assert ready.render.fps == fps
    assert ready.facestage.rig.data.shape_keys.animation_data is None
