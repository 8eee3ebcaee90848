"""Several faces in one scene, and several scenes in one file: each has its own of everything."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from addon.ui.refusal import refused
from reference.fit_scene import fit_scene
from reference.known import known


@pytest.fixture
def first(scene, stand_in, photo: Path, landmark_file: Path, tmp_path: Path):
    """A scene with one fitted face."""
    stand_in("works")
    scene.facestage.output, scene.facestage.light_count = str(tmp_path / "work"), 5
    fit_scene(photo, landmark_file)
    return scene


def place(item) -> np.ndarray:
    import bpy

    bpy.context.view_layer.update()
    return np.array(item.matrix_world)


def values(rig) -> dict[str, float]:
    return {key.name: key.value for key in rig.data.shape_keys.key_blocks}


def second_face(landmark_file: Path, seed: int = 7) -> None:
    import bpy

    for answer in (
        bpy.ops.facestage.add_face(),
        bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file)),
        bpy.ops.facestage.build_stage(),
        bpy.ops.facestage.build_rig(),
    ):
        assert answer == {"FINISHED"}
    bpy.context.scene.facestage.seed = seed
    assert bpy.ops.facestage.fit() == {"FINISHED"}


def test_a_second_face_has_its_own_of_everything(first, landmark_file: Path) -> None:
    settings = first.facestage
    rig, stage, result = settings.rig, settings.stage, settings.result
    camera, lens, seen = first.camera, first.camera.data.lens, place(first.camera)
    before, where = values(rig), place(rig)
    light = [each.data.energy for each in stage.children if each.type == "LIGHT"]
    second_face(landmark_file)
    assert settings.rig != rig and settings.stage != stage
    assert Path(settings.result) != Path(result) and Path(settings.result).is_dir()
    assert Path(result).is_dir()
    assert values(rig) == before and place(rig) == pytest.approx(where)
    assert [each.data.energy for each in stage.children if each.type == "LIGHT"] == light
    assert first.camera == camera and first.camera.data.lens == lens
    assert place(camera) == pytest.approx(seen)  # the stage moves, not the camera
    assert settings.face_number == 2 and len(settings.faces) == 2


def test_the_second_face_is_in_the_camera_where_the_fit_had_it(first, landmark_file) -> None:
    import bpy

    from facestage.contract.result import Result

    second_face(landmark_file)
    settings = first.facestage
    result = Result.load(Path(settings.result))
    assert known(result.camera).focal_px == pytest.approx(
        Result.load(Path(settings.faces[0].result)).camera.focal_px
    )
    shown = settings.rig.evaluated_get(bpy.context.evaluated_depsgraph_get())
    flat = np.empty(3 * len(shown.data.vertices), np.float32)
    shown.data.vertices.foreach_get("co", flat)
    matrix = np.linalg.inv(place(first.camera)) @ place(settings.rig)
    np.testing.assert_allclose(
        flat.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3], result.vertices, atol=4e-6
    )


def test_each_face_is_lit_by_its_own_stage(first, landmark_file: Path) -> None:
    import bpy

    rig, stage = first.facestage.rig, first.facestage.stage
    assert all(_lit_by(light) is None for light in stage.children if light.type == "LIGHT")
    second_face(landmark_file)
    other, others = first.facestage.rig, first.facestage.stage
    for face, lights in ((rig, stage), (other, others)):
        found = {_lit_by(light) for light in lights.children if light.type == "LIGHT"}
        assert len(found) == 1 and list(known(found.pop()).objects) == [face]
        beside = {
            each.light_linking.blocker_collection
            for each in lights.children
            if each.type == "LIGHT"
        }
        assert len(beside) == 1
        (shut_out,) = known(beside.pop()).collection_objects
        assert shut_out.light_linking.link_state == "EXCLUDE"
    assert not [item for item in _in_the_way(first) if item in (rig, stage)]
    assert bpy.ops.facestage.remove_face(number=2) == {"FINISHED"}
    assert all(_lit_by(light) is None for light in stage.children if light.type == "LIGHT")
    assert all(_shaded_by(light) is None for light in stage.children if light.type == "LIGHT")
    assert not [each for each in bpy.data.collections if each.name != "Facestage"]


def test_a_face_looks_as_if_it_were_alone(scene, head, tmp_path: Path) -> None:
    """A second head, with a stage of its own, stands between the first one and its lights."""
    import bpy

    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import build_stage, default_stage

    first = build_stage(scene, default_stage(5, 1.0, 0.2))
    build_rig(scene, head, "default", first)
    assert bpy.ops.facestage.add_face() == {"FINISHED"}
    second = build_stage(scene, default_stage(5, 1.0, 0.2))
    other = build_rig(scene, head, "default", second)
    second.location = (-0.3, -0.03, -0.05)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.location, camera.rotation_euler = (0.0, -0.8, 0.0), (np.pi / 2, 0.0, 0.0)
    together = _rendered(scene, tmp_path)
    for item in (other, *second.children_recursive):
        item.hide_render = True
    alone = _rendered(scene, tmp_path)
    there = np.isclose(alone, 0.0).sum() / alone.size
    assert 0.2 < there < 0.95  # the head is in the picture, and does not fill it
    shown = (alone > 0) & (together > 0)
    assert together[shown].mean() == pytest.approx(alone[shown].mean(), rel=0.01)
    for light in first.children:
        if light.type == "LIGHT":
            light.light_linking.blocker_collection = None
    other.hide_render = False
    assert _rendered(scene, tmp_path)[shown].mean() < 0.95 * alone[shown].mean()


def _rendered(scene, folder: Path) -> np.ndarray:
    """Radiance (h, w) by Cycles, direct light, where the first head is."""
    import bpy

    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_adaptive_sampling, scene.cycles.max_bounces = (
        64,
        False,
        0,
    )
    scene.cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = 48
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.image_settings.file_format = "OPEN_EXR"
    scene.render.filepath = str(folder / "picture.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath)
    pixels = np.array(image.pixels[:]).reshape(48, 48, 4)[:, 16:, 0]
    bpy.data.images.remove(image)
    return pixels


def _shaded_by(light):
    return light.light_linking.blocker_collection


def _lit_by(light):
    return light.light_linking.receiver_collection


def _in_the_way(scene) -> list[object]:
    from facestage_blender.scene.obstacles import obstacles

    return list(obstacles(scene))


def test_the_panel_is_about_the_face_that_is_shown(first, landmark_file: Path) -> None:
    import bpy

    rig, result = first.facestage.rig, first.facestage.result
    fitted = values(rig)
    second_face(landmark_file)
    other, of_other = first.facestage.rig, values(first.facestage.rig)
    assert bpy.ops.facestage.show_face(number=1) == {"FINISHED"}
    assert first.facestage.rig == rig and first.facestage.result == result
    assert first.facestage.seed != 7 and first.facestage.face_number == 1
    assert bpy.ops.facestage.set_expression(to="NEUTRAL") == {"FINISHED"}
    assert values(other) == of_other and values(rig) != fitted
    assert bpy.ops.facestage.apply_result() == {"FINISHED"}
    assert values(rig) == pytest.approx(fitted) and values(other) == of_other
    assert bpy.ops.facestage.show_face(number=2) == {"FINISHED"}
    assert first.facestage.rig == other and first.facestage.seed == 7
    refused(bpy.ops.facestage.show_face, "no face 3", number=3)


def test_another_photo_has_a_camera_of_its_own(first, landmark_file, photo, tmp_path) -> None:
    import bpy
    import cv2

    camera, seen = first.camera, place(first.camera)
    path = tmp_path / "other.png"
    assert cv2.imwrite(str(path), np.full((120, 60, 3), 99, np.uint8))
    assert bpy.ops.facestage.add_face() == {"FINISHED"}
    assert bpy.ops.facestage.choose_photo(filepath=str(path)) == {"FINISHED"}
    assert first.camera != camera and first.render.resolution_x == 60
    assert bpy.ops.facestage.show_face(number=1) == {"FINISHED"}
    assert first.camera == camera and first.render.resolution_x == 96
    assert Path(first.facestage.photo).name == photo.name
    assert place(camera) == pytest.approx(seen)


def test_a_removed_face_leaves_the_others(first, landmark_file: Path) -> None:
    import bpy

    rig, stage, objects = first.facestage.rig, first.facestage.stage, len(bpy.data.objects)
    before = values(rig)
    second_face(landmark_file)
    files = Path(first.facestage.result)
    assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    assert bpy.ops.facestage.remove_face(number=2) == {"FINISHED"}
    assert first.facestage.rig == rig and first.facestage.stage == stage
    assert values(rig) == before and len(bpy.data.objects) == objects
    assert not first.facestage.faces and files.is_dir()
    refused(bpy.ops.facestage.remove_face, "no face 1", number=1)


def test_a_face_without_a_rig_is_finished_first(scene) -> None:
    import bpy

    refused(bpy.ops.facestage.add_face, "Build the rig of this face first")
    assert not scene.facestage.faces


def test_a_saved_file_keeps_all_faces(first, landmark_file: Path, tmp_path: Path) -> None:
    import bpy

    second_face(landmark_file)
    names = [first.facestage.faces[0].rig.name, first.facestage.rig.name]
    path = tmp_path / "folder" / "two.blend"
    path.parent.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.wm.open_mainfile(filepath=str(path))
    scene = bpy.context.scene
    assert scene.facestage.faces[0].result.startswith("//")
    for number, name in enumerate(names, 1):
        assert bpy.ops.facestage.show_face(number=number) == {"FINISHED"}
        assert scene.facestage.rig.name == name
        assert bpy.ops.facestage.apply_result() == {"FINISHED"}


def test_two_scenes_of_a_file_keep_their_results_apart(
    scene, stand_in, photo: Path, landmark_file: Path, tmp_path: Path
) -> None:
    import bpy

    stand_in("works")
    scene.facestage.light_count = 5
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "film.blend"))
    fit_scene(photo, landmark_file)
    one, rig = bpy.path.abspath(scene.facestage.result), scene.facestage.rig
    before = values(rig)
    bpy.ops.scene.new(type="NEW")
    other = bpy.context.scene
    other.facestage.light_count = 5
    fit_scene(photo, landmark_file)
    assert bpy.path.abspath(other.facestage.result) != one
    assert other.facestage.rig != rig and values(rig) == before
    assert Path(one).is_dir() and Path(bpy.path.abspath(other.facestage.result)).is_dir()
    bpy.ops.scene.delete()


def test_a_fit_goes_to_the_scene_that_it_was_started_in(
    scene, stand_in, photo: Path, landmark_file: Path, tmp_path: Path
) -> None:
    """As when another scene is shown in the window before the fit is done."""
    import bpy

    from facestage_blender.ui.backend_task import BackendTask, Running
    from facestage_blender.ui.fit import FACESTAGE_OT_fit

    class Task(BackendTask):  # Blender makes its operators itself
        task, apply, resume = "Fitting", True, False
        command = FACESTAGE_OT_fit.command
        finish = FACESTAGE_OT_fit.finish  # type: ignore[assignment]
        following = FACESTAGE_OT_fit.following  # type: ignore[assignment]

        def report(self, _kind: set[str], _text: str) -> None: ...  # type: ignore[override]

    stand_in("works")
    scene.facestage.output, scene.facestage.light_count = str(tmp_path / "work"), 5
    fit_scene(photo, landmark_file)
    rig = scene.facestage.rig
    fitted = values(rig)
    bpy.ops.facestage.set_expression(to="NEUTRAL")
    task = Task()
    assert task._start(bpy.context)
    process = known(Running.process)
    outcome = process.wait()
    bpy.ops.scene.new(type="NEW")
    other = bpy.context.scene
    verdict = task._begin_following(bpy.context, task._end(bpy.context, process, outcome))
    while verdict == {"RUNNING_MODAL"}:
        assert bpy.context.scene == other
        verdict = task._step(bpy.context)
    assert verdict == {"FINISHED"}
    assert bpy.context.scene == other and not other.facestage.result
    assert values(rig) == pytest.approx(fitted)
    bpy.ops.scene.delete()
