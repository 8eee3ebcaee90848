"""Operators: the same as their functions, one undo step, the user's place kept, errors in one
sentence.
"""

from __future__ import annotations

import os
import re
import signal
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from addon.ui.refusal import refused
from reference.known import known


def describe(scene) -> dict[str, object]:
    """Everything of the scene that Facestage may change, as plain values."""
    scene.view_layers[0].update()
    description: dict[str, object] = {}
    for item in sorted(scene.objects, key=lambda item: item.name):
        description[item.name] = [round(value, 5) for row in item.matrix_basis for value in row]
        if item.type == "LIGHT":
            description[f"{item.name} light"] = (
                round(item.data.energy, 5),
                [round(value, 5) for value in item.data.color],
                item.facestage_light.state,
            )
        if item.type == "MESH":
            keys = item.data.shape_keys.key_blocks
            description[f"{item.name} keys"] = {key.name: round(key.value, 5) for key in keys}
            face = item.facestage_face
            description[f"{item.name} pictures"] = (
                face.albedo_image.size[:],
                face.specular_image.size[:],
                face.roughness,
            )
        if item.type == "CAMERA":
            description[f"{item.name} lens"] = (
                round(item.data.lens, 4),
                round(item.data.shift_x, 5),
            )
    return description


@pytest.fixture
def ready(scene, stand_in, photo: Path, landmark_file: Path, tmp_path: Path):
    """A scene set up by the operators alone."""
    import bpy

    stand_in("works")
    scene.facestage.output = str(tmp_path / "work")
    scene.facestage.light_count = 5
    for answer in (
        bpy.ops.facestage.choose_photo(filepath=str(photo)),
        bpy.ops.facestage.choose_landmarks(filepath=str(landmark_file)),
        bpy.ops.facestage.build_stage(),
        bpy.ops.facestage.build_rig(),
    ):
        assert answer == {"FINISHED"}
    return scene


def test_operators_equal_their_functions(ready, head, photo: Path, landmark_file: Path) -> None:
    import bpy

    from facestage_blender.exchange.photos import choose_photo
    from facestage_blender.pins.aiming import aim_camera
    from facestage_blender.rig.face_rig import build_rig
    from facestage_blender.scene.stage import build_stage, default_stage

    by_operators = describe(ready)
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    choose_photo(scene, photo)
    scene.facestage.landmarks = str(landmark_file)
    build_rig(scene, head, "default", build_stage(scene, default_stage(5, 1.0, 0.2)))
    aim_camera(scene)
    assert describe(scene) == by_operators


def test_fit_operator_equals_apply_function(ready, tmp_path: Path) -> None:
    import bpy

    from facestage.contract.result import Result
    from facestage_blender.exchange.write_back import apply_result

    before = describe(ready)
    assert bpy.ops.facestage.fit(apply=False) == {"FINISHED"}
    assert describe(ready) == before
    assert bpy.ops.facestage.apply_result() == {"FINISHED"}
    by_operator = describe(ready)
    assert by_operator != before
    apply_result(ready, Result.load(tmp_path / "work" / "result"))
    assert describe(ready) == by_operator
    state = bpy.context.window_manager.facestage
    assert state.verdict == "The stand-in is content." and not state.doubtful
    assert bpy.ops.facestage.prepare_relight() == {"FINISHED"}
    assert state.verdict == "The stand-in is content."  # it is still of this result


def test_a_result_with_a_but_is_shown_as_a_warning(
    ready, capfd: pytest.CaptureFixture[str], monkeypatch
) -> None:
    import bpy

    monkeypatch.setenv("STAND_IN_STATUS", "stopped")
    assert bpy.ops.facestage.fit(apply=False) == {"FINISHED"}
    assert bpy.context.window_manager.facestage.doubtful
    assert "Warning: The stand-in is content." in capfd.readouterr().out


def test_apply_is_one_undo_step(ready) -> None:
    import bpy

    bpy.ops.facestage.fit(apply=False)
    before = describe(ready)
    bpy.ops.ed.undo_push(message="before")
    bpy.ops.facestage.apply_result()
    # what Blender does after an operator that the user starts
    bpy.ops.ed.undo_push(message="Apply Result")
    after = describe(bpy.context.scene)
    assert after != before
    bpy.ops.ed.undo()
    assert describe(bpy.context.scene) == before
    bpy.ops.ed.redo()
    assert describe(bpy.context.scene) == after


@pytest.mark.parametrize("mode", ["OBJECT", "EDIT", "SCULPT"])
@pytest.mark.parametrize("action", ["apply_result", "build_stage", "build_rig"])
def test_mode_active_object_and_selection_are_kept(ready, mode: str, action: str) -> None:
    import bpy

    bpy.ops.facestage.fit(apply=False)
    layer = bpy.context.view_layer
    rig, light = ready.facestage.rig, bpy.data.objects["Facestage Light 02"]
    for item in layer.objects:
        item.select_set(item == light)
    layer.objects.active = rig
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode=mode)
    assert getattr(bpy.ops.facestage, action)() == {"FINISHED"}
    assert layer.objects.active == rig
    assert rig.mode == mode
    assert [item for item in layer.objects if item.select_get()] == [light]
    if mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


def test_mode_is_kept_when_applying_fails(ready) -> None:
    import bpy

    bpy.context.view_layer.objects.active = ready.facestage.rig
    bpy.ops.object.mode_set(mode="EDIT")
    refused(bpy.ops.facestage.apply_result, "run a fit first")
    assert ready.facestage.rig.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")


def test_users_errors_are_one_sentence(
    scene, stand_in, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import bpy

    stand_in("works")
    refused(bpy.ops.facestage.fit, "Choose Photo")
    refused(bpy.ops.facestage.choose_photo, "does not exist", filepath=str(tmp_path / "absent.png"))
    refused(
        bpy.ops.facestage.choose_landmarks, "does not exist", filepath=str(tmp_path / "absent.json")
    )
    refused(bpy.ops.facestage.open_report, "run a fit first")
    refused(bpy.ops.facestage.relight, "Build Light Stage", direction="left")
    monkeypatch.setenv("FACESTAGE_BACKEND", "/no/such/program")
    refused(bpy.ops.facestage.build_rig, "/no/such/program")
    assert "/no/such/program" in bpy.context.window_manager.facestage.failure
    assert not bpy.context.window_manager.facestage.task


@pytest.mark.parametrize(
    ("mood", "sentence"), [("refuses", "photo is of a cat"), ("crashes", "out of luck")]
)
def test_failed_fit_leaves_the_scene_alone(ready, stand_in, mood: str, sentence: str) -> None:
    import bpy

    before = describe(ready)
    stand_in(mood)
    refused(bpy.ops.facestage.fit, sentence)
    assert describe(ready) == before
    assert sentence in bpy.context.window_manager.facestage.failure


def test_killed_backend_leaves_blender_and_the_scene(ready, stand_in, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.ui.backend_task import Running

    before = describe(ready)
    stand_in("hangs in fit")
    partial = tmp_path / "work" / "result.partial"

    def kill() -> None:
        while not partial.exists():
            time.sleep(0.02)
        os.kill(known(Running.process).pid, signal.SIGKILL)

    killer = threading.Thread(target=kill)
    killer.start()
    refused(bpy.ops.facestage.fit, "killed")
    killer.join()
    assert describe(ready) == before
    assert partial.is_dir()
    stand_in("works")
    assert bpy.ops.facestage.fit(resume=True) == {"FINISHED"}
    assert describe(ready) != before


def exit_code(child, seconds: float = 20.0) -> int | None:
    """How a backend process ended; None where it does not, and then it is killed."""
    deadline = time.monotonic() + seconds
    while child.outcome() is None and time.monotonic() < deadline:
        time.sleep(0.02)
    outcome = child.outcome()
    if outcome is None:
        os.kill(child.pid, signal.SIGKILL)
    return None if outcome is None else outcome.code


def test_disabling_the_addon_stops_the_backend(scene, stand_in) -> None:
    from facestage_blender.backend.process import BackendProcess
    from facestage_blender.ui.backend_task import Running, stop_running

    Running.process = child = BackendProcess([*stand_in("hangs"), "fit"])
    stop_running()
    assert exit_code(child) == 3
    assert Running.process is None


def test_a_closed_window_stops_its_task_and_frees_the_buttons(scene, stand_in) -> None:
    import bpy

    from facestage_blender.backend.process import BackendProcess
    from facestage_blender.ui.backend_task import BackendTask, Running

    task = BackendTask()
    Running.process = task._process = child = BackendProcess([*stand_in("hangs"), "fit"])
    bpy.context.window_manager.facestage.task = "Fitting"
    task.cancel(bpy.context)
    assert exit_code(child) == 3
    assert vars(Running)["process"] is None
    assert not bpy.context.window_manager.facestage.task
    Running.process = later = BackendProcess([*stand_in("works"), "doctor"])
    task.cancel(bpy.context)  # one that was started since is not its own
    assert Running.process is later and later.wait().ok
    Running.process = None


def test_a_new_file_stops_the_backend_and_frees_the_buttons(scene, stand_in) -> None:
    import bpy

    from facestage_blender.backend.process import BackendProcess
    from facestage_blender.ui.backend_task import Running

    Running.process = child = BackendProcess([*stand_in("hangs"), "fit"])
    bpy.context.window_manager.facestage.task = "Fitting"
    bpy.ops.wm.read_homefile(use_empty=True)
    assert exit_code(child) == 3
    assert vars(Running)["process"] is None
    assert not bpy.context.window_manager.facestage.task


def test_cancelling_is_no_error(ready, stand_in) -> None:
    import bpy

    from facestage_blender.ui.backend_task import Running

    stand_in("hangs")
    began = Running.process

    def cancel() -> None:
        while Running.process is began:
            time.sleep(0.02)
        known(Running.process).cancel()

    canceller = threading.Thread(target=cancel)
    canceller.start()
    assert bpy.ops.facestage.fit() == {"CANCELLED"}
    canceller.join()
    state = bpy.context.window_manager.facestage
    assert not state.failure and not state.task
    assert state.notice.startswith("Cancelled")
    assert not state.verdict  # what the work was at is no result


def test_check_backend_shows_the_report(scene, stand_in) -> None:
    import bpy

    from facestage_blender.preferences import addon_preferences

    stand_in("works")
    assert bpy.ops.facestage.check_backend() == {"FINISHED"}
    assert known(addon_preferences(bpy.context)).report == "everything works"


def test_relight_and_light_states(ready) -> None:
    import bpy

    from facestage_blender.scene.stage import read_stage, stage_lights

    before = read_stage(ready.facestage.stage)
    assert bpy.ops.facestage.relight(direction="right") == {"FINISHED"}
    lit = read_stage(ready.facestage.stage)
    assert not np.allclose(lit.radiance, before.radiance)
    assert bpy.ops.facestage.relight(direction="fitted") == {"FINISHED"}
    np.testing.assert_allclose(
        read_stage(ready.facestage.stage).radiance, before.radiance, rtol=1e-5
    )
    assert bpy.ops.facestage.light_states(state="OFF") == {"FINISHED"}
    assert all(light.hide_render for light in stage_lights(ready.facestage.stage))


def test_all_properties_and_operators_explain_themselves(scene) -> None:
    import bpy

    from facestage_blender import properties as settings
    from facestage_blender.registration import MODULES

    for group in settings.CLASSES:
        for name, prop in group.bl_rna.properties.items():
            assert name in ("rna_type", "name") or prop.description, (
                f"{group.__name__}.{name} has no tooltip"
            )
            for item in getattr(prop, "enum_items", ()):
                assert not re.search(r"\b(db|cpu|nvidia)\b", item.description), item.description
    registered = [
        cls for module in MODULES for cls in module.CLASSES if cls.__name__.startswith("FACESTAGE_")
    ]
    assert len(registered) > 20
    for cls in registered:
        assert cls.__doc__
        assert hasattr(bpy.types, cls.__name__)
        if issubclass(cls, bpy.types.Operator):
            operator = getattr(bpy.ops.facestage, cls.bl_idname.split(".")[1])
            tooltip = operator.get_rna_type().description
            assert tooltip == " ".join(tooltip.split()), f"{cls.__name__} breaks its tooltip"


def test_face_model_is_chosen_with_its_license(ready, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.rig.model_kinds import KINDS, model_label, model_license

    assert model_license(ready) == "CC0-1.0"  # as the model of the rig says
    file = tmp_path / "somebody.npz"
    file.write_bytes(b"")
    assert bpy.ops.facestage.choose_model(kind="npz", filepath=str(file)) == {"FINISHED"}
    assert ready.facestage.model == f"npz:{file}"
    assert model_label(ready.facestage.model) == "Facestage Model (somebody.npz)"
    assert model_license(ready) == KINDS["npz"].license  # the rig is of another model
    assert bpy.ops.facestage.choose_model(kind="ict", filepath=str(tmp_path)) == {"FINISHED"}
    assert ready.facestage.model == f"ict:{tmp_path}"
    refused(
        bpy.ops.facestage.choose_model,
        "does not exist",
        kind="flame",
        filepath=str(tmp_path / "absent.pkl"),
    )
    refused(bpy.ops.facestage.choose_model, "choose the file", kind="bfm")
    assert ready.facestage.model == f"ict:{tmp_path}"
    assert bpy.ops.facestage.choose_model(kind="default") == {"FINISHED"}
    assert model_license(ready) == "CC0-1.0"
