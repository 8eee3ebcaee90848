"""A tracked film becomes an animation: every frame's vertices are where the film's were."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from addon.exchange.films import FRAMES, RATE, WIDTH
from addon.ui.refusal import refused
from facestage.contract.sequence import Sequence
from facestage.contract.wrinkles import Wrinkles


def keyframe(sequence: Sequence):
    """The person whom the scene gets."""
    from facestage_blender.exchange.performance import keyframe_of

    return keyframe_of(sequence)


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
    for place in range(FRAMES):
        ready.frame_set(101 + place)
        wanted = head.shape(keyframe(sequence).identity, sequence.expression[place])
        pose = sequence.model_to_camera[place]
        wanted = wanted @ pose[:3, :3].T + pose[:3, 3]
        assert np.abs(in_camera(ready) - wanted).max() < 2e-5, place


def test_light_that_changes_is_keyed(ready, sequence: Sequence) -> None:
    import bpy

    from facestage_blender.scene.stage import read_stage, require_stage

    folder = Path(str(sequence.folder))
    lights = len(keyframe(sequence).stage)
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


def with_haemoglobin(sequence: Sequence, head, harmonics: int = 4) -> Sequence:
    rng = np.random.default_rng(2)
    return replace(
        sequence,
        haemoglobin=rng.normal(size=(FRAMES, harmonics)),
        haemoglobin_harmonics=rng.normal(size=(harmonics, len(head.vertices))),
        haemoglobin_color=np.array([-0.04, -0.09, -0.06]),
    )


def haemoglobin_tree(rig):
    trees = (slot.material.node_tree for slot in rig.material_slots)
    return next(tree for tree in trees if "Haemoglobin" in tree.nodes)


def haemoglobin_of(rig) -> np.ndarray:
    """(n,) what the material makes of it now, on the rig's vertices."""
    shown = np.zeros(len(rig.data.vertices))
    for number in range(2):
        functions = np.empty(3 * len(shown), np.float32)
        name = f"facestage_haemoglobin_{number}"
        rig.data.attributes[name].data.foreach_get("vector", functions)
        weights = haemoglobin_tree(rig).nodes[f"Haemoglobin Weights {number}"].inputs[1]
        shown += functions.reshape(-1, 3) @ np.array(weights.default_value)
    return shown


def test_haemoglobin_is_keyed_and_gone_with_a_film_that_has_none(
    ready, sequence: Sequence, head
) -> None:
    import bpy

    from facestage_blender.rig.keyframes import curves_of

    folder = Path(str(sequence.folder))
    changing = with_haemoglobin(sequence, head)
    assert changing.haemoglobin is not None and changing.haemoglobin_harmonics is not None
    changing.write_into(folder)
    ready.frame_set(101)
    for _ in range(2):  # the second time in its own place
        assert bpy.ops.facestage.import_performance(directory=str(folder)) == {"FINISHED"}
    rig = ready.facestage.rig
    tree = haemoglobin_tree(rig)
    assert len(list(curves_of(tree))) == 4
    for place in (0, 5, FRAMES - 1):
        ready.frame_set(101 + place)
        wanted = changing.haemoglobin[place] @ changing.haemoglobin_harmonics
        np.testing.assert_allclose(haemoglobin_of(rig), wanted, atol=1e-5)

    sequence.write_into(folder)
    assert bpy.ops.facestage.import_performance(directory=str(folder)) == {"FINISHED"}
    assert "Haemoglobin" not in tree.nodes and not list(curves_of(tree))
    assert not [one for one in rig.data.attributes if one.name.startswith("facestage_haemo")]
    albedo = tree.nodes["Facestage Skin"].inputs["Albedo"]
    assert albedo.links[0].from_node.type == "TEX_IMAGE"


def test_importing_haemoglobin_is_one_undo_step(ready, sequence: Sequence, head) -> None:
    import bpy

    from facestage_blender.rig.keyframes import curves_of

    folder = Path(str(sequence.folder))
    with_haemoglobin(sequence, head).write_into(folder)

    def shown() -> tuple[list[bool], int, list[str]]:
        rig = bpy.context.scene.facestage.rig
        trees = [slot.material.node_tree for slot in rig.material_slots]
        curves = sum(len(list(curves_of(tree))) for tree in trees)
        names = [one.name for one in rig.data.attributes if one.name.startswith("facestage_haemo")]
        return ["Haemoglobin" in tree.nodes for tree in trees], curves, names

    before = shown()
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.facestage.import_performance(directory=str(folder))
    bpy.ops.ed.undo_push(message="Import Performance")  # as Blender does after a user's operator
    after = shown()
    assert after != before and after[1] == 4
    bpy.ops.ed.undo()
    assert shown() == before
    bpy.ops.ed.redo()
    assert shown() == after


def test_haemoglobin_of_another_mesh_is_refused(ready, sequence: Sequence, head) -> None:
    import bpy

    folder = Path(str(sequence.folder))
    other = with_haemoglobin(sequence, head)
    assert other.haemoglobin_harmonics is not None
    replace(other, haemoglobin_harmonics=other.haemoglobin_harmonics[:, 1:]).write_into(folder)
    refused(bpy.ops.facestage.import_performance, "the rig has", directory=str(folder))
    assert ready.facestage.rig.data.shape_keys.animation_data is None


def with_wrinkles(sequence: Sequence) -> Sequence:
    """A normal map of skin that is flat, and one that is not."""
    import bpy

    from facestage_blender.pictures.render import save_exr

    names = sequence.expression_names
    wrinkles = Wrinkles("smile", names[:2]), Wrinkles("frown", names[2:3])
    for each in wrinkles:
        save_exr(Path(str(sequence.folder)) / each.normal_file, np.full((8, 8, 3), 0.5, np.float32))
    assert not [one for one in bpy.data.images if one.name.startswith("Facestage Wrinkles")]
    return replace(sequence, wrinkles=wrinkles)


def test_wrinkles_follow_the_sliders_and_go_with_a_film_that_has_none(
    ready, sequence: Sequence
) -> None:
    import bpy

    folder = Path(str(sequence.folder))
    wrinkled = with_wrinkles(sequence)
    wrinkled.write_into(folder)
    ready.frame_set(101)
    for _ in range(2):  # the second time in its own place
        assert bpy.ops.facestage.import_performance(directory=str(folder)) == {"FINISHED"}
    rig = ready.facestage.rig
    (tree,) = (
        slot.material.node_tree
        for slot in rig.material_slots
        if "Wrinkles" in slot.material.node_tree.nodes
    )
    for place in (0, 5, FRAMES - 1):
        ready.frame_set(101 + place)
        for name, columns in (("smile", slice(0, 2)), ("frown", slice(2, 3))):
            strength = tree.nodes[f"Wrinkles {name}"].inputs["Strength"].default_value
            wanted = sequence.expression[place, columns].mean()
            assert strength == pytest.approx(max(wanted, 0.0), abs=1e-5)
    assert sum(one.name.startswith("Facestage Wrinkles") for one in bpy.data.images) == 2

    (folder / wrinkled.wrinkles[0].normal_file).unlink()
    again = bpy.ops.facestage.import_performance
    refused(again, "has no .*; track the film again", directory=str(folder))
    assert "Wrinkles" in tree.nodes
    sequence.write_into(folder)
    assert bpy.ops.facestage.import_performance(directory=str(folder)) == {"FINISHED"}
    assert "Wrinkles" not in tree.nodes and not list(tree.animation_data.drivers)
    assert not [one for one in bpy.data.images if one.name.startswith("Facestage Wrinkles")]


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


def test_simplified_curves_have_fewer_keys_and_stay_near(ready, sequence: Sequence, head) -> None:
    import bpy

    from facestage_blender.rig.face_rig import key_name
    from facestage_blender.rig.keyframes import curves_of
    from facestage_blender.scene.stage import require_stage, stage_lights

    count, near = 60, 0.02
    smooth = np.sin(np.linspace(0, 7, count))[:, None] * np.linspace(0.1, 0.5, head_size(head))
    poses = np.tile(sequence.model_to_camera[0], (count, 1, 1))
    poses[:, 0, 3] += 0.02 * np.sin(np.linspace(0, 5, count))
    frames = tuple(replace(sequence.frames[0], number=5 + k, time=k / RATE) for k in range(count))
    blood = 0.8 * np.sin(np.linspace(0, 5, count))
    power = 2.0 + np.sin(np.linspace(0, 5, count))
    radiance = power[:, None, None] * np.ones((len(keyframe(sequence).stage), 3))
    long = replace(
        sequence,
        frames=frames,
        expression=0.5 + smooth,
        model_to_camera=poses,
        light_radiance=radiance,
        haemoglobin=blood[:, None],
        haemoglobin_harmonics=np.ones((1, len(head.vertices))),
        haemoglobin_color=np.array([-0.04, -0.09, -0.06]),
    )
    long.write_into(Path(str(sequence.folder)))
    ready.frame_set(1)
    bpy.ops.facestage.import_performance(directory=str(sequence.folder), simplify=near)
    rig = ready.facestage.rig
    shapes, times = rig.data.shape_keys, 1 + np.arange(count)
    by_path = {curve.data_path: curve for curve in curves_of(shapes)}
    keys = 0
    for name, column in zip(long.expression_names, long.expression.T, strict=True):
        curve = by_path[shapes.key_blocks[key_name(name)].path_from_id("value")]
        played = np.array([curve.evaluate(time) for time in times])
        assert np.abs(played - column).max() <= near + 1e-5
        keys += len(curve.keyframe_points)
    assert keys < 0.4 * count * len(long.expression_names)
    (pulse,) = (
        curve for slot in rig.material_slots for curve in curves_of(slot.material.node_tree)
    )
    played = np.array([pulse.evaluate(time) for time in times])
    assert np.abs(played - blood).max() <= near + 1e-5 and len(pulse.keyframe_points) < count / 2
    light = stage_lights(require_stage(ready))[0].data
    (energy,) = (curve for curve in curves_of(light) if curve.data_path == "energy")
    played = np.array([energy.evaluate(time) for time in times])
    shares = played / played.max() - power / power.max()
    assert np.abs(shares).max() <= near + 1e-3 and len(energy.keyframe_points) < count / 2
    place = next(
        curve for curve in curves_of(rig) if (curve.data_path, curve.array_index) == ("location", 0)
    )
    played = np.array([place.evaluate(time) for time in times])
    assert len(place.keyframe_points) < count / 2
    np.testing.assert_allclose(played - played[0], poses[:, 0, 3] - poses[0, 0, 3], atol=4.1e-3)


def head_size(head) -> int:
    return len(head.expression_names)


def test_thinning_keeps_corners_and_what_is_pinned() -> None:
    from facestage_blender.rig.keyframes import Thinning

    frames = np.arange(9.0)
    values = np.array([0.0, 1, 2, 3, 4, 3, 2, 1, 0])
    assert Thinning(0.01).kept(frames, values).tolist() == [0, 4, 8]
    pinned = frames == 6
    assert Thinning(0.01, pinned).kept(frames, values).tolist() == [0, 4, 6, 8]
    assert Thinning(10.0, pinned).kept(frames, values).tolist() == [0, 6, 8]
    assert len(Thinning(0.0, pinned).kept(frames, values)) == 9


def test_without_a_window_the_command_line_animates(
    sequence: Sequence, head, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    import bpy

    from facestage_blender.headless import batch

    out, folder = tmp_path / "out", str(sequence.folder)
    changing = with_haemoglobin(sequence, head)
    assert changing.haemoglobin is not None
    changing.write_into(Path(folder))
    assert batch.main(["--performance", folder, "--out", str(out), "--add", "handles"]) == 0
    assert f"Scene: {out / 'scene.blend'}" in capfd.readouterr().out
    bpy.ops.wm.open_mainfile(filepath=str(out / "scene.blend"))
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (1, FRAMES, 1)
    for place in (0, 5, FRAMES - 1):
        scene.frame_set(1 + place)
        pose = sequence.model_to_camera[place]
        identity = keyframe(sequence).identity
        wanted = head.shape(identity, sequence.expression[place]) @ pose[:3, :3].T + pose[:3, 3]
        assert np.abs(in_camera(scene) - wanted).max() < 2e-5
        np.testing.assert_allclose(
            haemoglobin_of(scene.facestage.rig),
            changing.haemoglobin[place] @ changing.haemoglobin_harmonics,
            atol=1e-5,
        )


def test_the_command_line_simplifies_curves(sequence: Sequence, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.headless import batch
    from facestage_blender.rig.keyframes import curves_of

    counts: list[set[int]] = []
    for more in ([], ["--simplify", "1"]):
        out = tmp_path / f"out{len(counts)}"
        line = ["--performance", str(sequence.folder), "--out", str(out), *more]
        assert batch.main(line) == 0
        bpy.ops.wm.open_mainfile(filepath=str(out / "scene.blend"))
        shapes = bpy.context.scene.facestage.rig.data.shape_keys
        counts.append({len(curve.keyframe_points) for curve in curves_of(shapes)})
    assert counts == [{FRAMES}, {2}]


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--budget", "draft"], "leave out --budget"),
        (["--focal-px", "90"], "leave out --focal-px"),
        (["--export", "face.doc"], "face.doc"),
    ],
)
def test_what_is_said_to_a_fit_is_refused_of_a_performance(
    sequence: Sequence, tmp_path: Path, capfd: pytest.CaptureFixture[str], more: list[str], words
) -> None:
    from facestage_blender.headless import batch

    out = tmp_path / "out"
    assert batch.main(["--performance", str(sequence.folder), "--out", str(out), *more]) == 2
    assert words in capfd.readouterr().err
    assert not out.exists()
