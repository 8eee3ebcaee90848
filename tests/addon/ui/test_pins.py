"""Pins by the operators: dragged, removed, undone, saved, handed to the fit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from addon.ui.refusal import refused
from facestage.contract.face_model import FaceModel
from facestage.contract.job import Job
from reference.known import known


@pytest.fixture
def ready(scene, stand_in, head: FaceModel, photo: Path, tmp_path: Path):
    """The egg in front of the camera, its face in the photo."""
    import bpy

    from facestage_blender.scene.camera import ensure_camera

    stand_in("works")
    scene.facestage.output = str(tmp_path / "work")
    for answer in (
        bpy.ops.facestage.choose_photo(filepath=str(photo)),
        bpy.ops.facestage.build_stage(),
        bpy.ops.facestage.build_rig(),
    ):
        assert answer == {"FINISHED"}
    ensure_camera(scene, scene.collection).location = (0.0, -0.6, 0.0)
    scene.facestage.result = str(tmp_path)  # a face that was fitted
    return scene


def faced(scene) -> np.ndarray:
    """(n, 2) where the rig's vertices show in the photo."""
    from facestage_blender.pins.pinning import Setting
    from facestage_blender.pins.rig_shapes import current_vertices

    setting = Setting.of(scene)
    to_camera = setting.guess().to_camera
    return setting.lens.project(
        current_vertices(setting.rig) @ to_camera[:3, :3].T + to_camera[:3, 3]
    )


def sliders(scene) -> np.ndarray:
    keys = scene.facestage.rig.data.shape_keys.key_blocks
    return np.array([key.value for key in keys])


def pins_of(scene):
    from facestage_blender.pins.record import Record

    return Record.of(scene.facestage, scene.facestage.rig).pins


def test_what_is_dragged_goes_there_and_the_rest_follows(ready) -> None:
    import bpy

    before, start, to = faced(ready), np.array([48.0, 42.0]), np.array([50.0, 40.5])
    assert bpy.ops.facestage.drag_pin(start=start, to=to) == {"FINISHED"}
    pins = pins_of(ready)
    np.testing.assert_allclose(pins.points, [to], atol=1e-5)
    shown = np.einsum("pi,pix->px", pins.weights, faced(ready)[pins.corners])
    np.testing.assert_allclose(shown, pins.points, atol=0.1)
    was = np.einsum("pi,pix->px", pins.weights, before[pins.corners])
    # weights of the surface, not of the screen
    np.testing.assert_allclose(was, [start], atol=0.02)
    assert np.median(np.linalg.norm(faced(ready) - before, axis=1)) > 0.1
    assert bpy.ops.facestage.drag_pin(start=(56, 42), to=(56, 42)) == {"FINISHED"}
    assert len(pins_of(ready)) == 2


def test_a_pin_is_taken_again_and_removed(ready) -> None:
    import bpy

    before = faced(ready), sliders(ready)
    bpy.ops.facestage.drag_pin(start=(48, 42), to=(51, 42))
    bpy.ops.facestage.drag_pin(start=(51, 42), to=(49, 43))
    assert len(pins_of(ready)) == 1
    bpy.ops.facestage.drag_pin(start=(40, 50), to=(40, 51))
    with_two = faced(ready)
    refused(bpy.ops.facestage.remove_pin, "There is no pin 3; the photo has 2.", number=3)
    assert bpy.ops.facestage.remove_pin(number=2) == {"FINISHED"}
    assert np.abs(faced(ready) - with_two).max() > 0.1
    assert bpy.ops.facestage.remove_pin() == {"FINISHED"}
    np.testing.assert_allclose(faced(ready), before[0], atol=1e-3)
    np.testing.assert_allclose(sliders(ready), before[1], atol=1e-5)
    assert ready.facestage.pins == ""


def test_pins_go_into_the_job_of_their_photo_and_are_cleared(ready, tmp_path: Path) -> None:
    import bpy

    bpy.ops.facestage.drag_pin(start=(48, 42), to=(49, 42))
    ready.facestage.result = ""
    assert bpy.ops.facestage.fit(apply=False) == {"FINISHED"}
    given, taken = pins_of(ready), known(Job.load(tmp_path / "work" / "job").pins)
    for name, value in vars(given).items():
        np.testing.assert_array_equal(getattr(taken, name), value, err_msg=name)
    face = faced(ready)
    assert bpy.ops.facestage.clear_pins() == {"FINISHED"}
    np.testing.assert_array_equal(faced(ready), face)
    bpy.ops.facestage.fit(apply=False)
    assert Job.load(tmp_path / "work" / "job").pins is None


def test_the_fit_starts_from_the_face_as_it_was_pinned(ready, tmp_path: Path) -> None:
    import bpy

    from facestage_blender.pins.pinning import Setting

    ready.facestage.result = ""
    bpy.ops.facestage.drag_pin(start=(48, 42), to=(51, 41))
    bpy.ops.facestage.fit(apply=False)
    job, setting = Job.load(tmp_path / "work" / "job"), Setting.of(ready)
    assert job.camera is None
    assert job.initial["focal_px"] == pytest.approx(setting.lens.focal_px)
    guess = setting.guess()
    np.testing.assert_allclose(job.initial["model_to_camera"][:3, 3], guess.to_camera[:3, 3])
    shown = np.concatenate([job.initial["identity"], job.initial["expression"]])
    np.testing.assert_allclose(shown, guess.sliders)
    ready.facestage.known_lens = True
    bpy.ops.facestage.fit(apply=False)
    assert "focal_px" not in Job.load(tmp_path / "work" / "job").initial
    bpy.ops.facestage.clear_pins()
    bpy.ops.facestage.fit(apply=False)
    assert Job.load(tmp_path / "work" / "job").initial == {}


@pytest.mark.parametrize("wrong", [0.75, 1.4])
@pytest.mark.parametrize("asked", [True, False])
def test_pins_find_the_focal_length_when_asked(ready, wrong: float, asked: bool) -> None:
    """The egg through a wrong lens, pinned to where the right one shows it."""
    import bpy

    from facestage_blender.pins.pinning import Pinning
    from facestage_blender.pins.record import Record, with_pin

    places, data = faced(ready), ready.camera.data
    truth, rig = data.lens, ready.facestage.rig
    near = np.linalg.norm(places - places[places[:, 0].argsort()].mean(axis=0), axis=1) < 20
    vertices = [v for v in np.flatnonzero(near)[::15] if rig.data.vertices[v].co.y < 0.05]
    data.lens = start = wrong * truth
    rig.location.y += (wrong - 1.0) * 0.6
    ready.view_layers[0].update()
    record = Record.of(ready.facestage, rig)
    pins = record.pins
    for vertex in vertices:
        pins = with_pin(pins, np.full(3, vertex), np.array([1.0, 0, 0]), places[vertex], 0.05)
    Record(record.model, pins).store(ready.facestage)
    ready.facestage.pin_focal = asked
    for _ in range(3):
        where = places[vertices[0]]
        assert bpy.ops.facestage.drag_pin(start=where, to=where) == {"FINISHED"}
    print(f"{len(pins)} pins: {start:.1f} mm to {data.lens:.1f}, true {truth:.1f}")
    if not asked:
        assert data.lens == pytest.approx(start)
        return
    assert data.lens == pytest.approx(truth, rel=0.1)
    np.testing.assert_allclose(Pinning(ready).shown, pins.points, atol=0.2)
    bpy.ops.facestage.drag_pin(start=where, to=where)
    while ready.facestage.pins:
        assert bpy.ops.facestage.remove_pin() == {"FINISHED"}
    assert data.lens == pytest.approx(start)


def test_a_lens_that_is_known_stays(ready) -> None:
    import bpy

    from facestage_blender.pins.pinning import finds_focal

    assert not finds_focal(ready)
    ready.facestage.pin_focal = True
    assert finds_focal(ready)
    for name in ("known_lens", "keep_camera"):
        setattr(ready.facestage, name, True)
        assert not finds_focal(ready)
        setattr(ready.facestage, name, False)
    ready.facestage.freeze = {"focal"}
    assert not finds_focal(ready)
    lens = ready.camera.data.lens
    bpy.ops.facestage.drag_pin(start=(48, 42), to=(51, 41))
    assert ready.camera.data.lens == lens


def test_a_face_that_was_moved_since_is_where_the_next_pin_begins(ready) -> None:
    import bpy

    bpy.ops.facestage.drag_pin(start=(48, 42), to=(49, 42))
    rig = ready.facestage.rig
    rig.data.shape_keys.key_blocks["identity/mode_1"].value = 2.0
    moved = faced(ready)
    bpy.ops.facestage.remove_pin()
    np.testing.assert_allclose(faced(ready), moved, atol=1e-3)


def test_pins_are_saved_with_the_file(ready, tmp_path: Path) -> None:
    import bpy

    bpy.ops.facestage.drag_pin(start=(48, 42), to=(49, 42))
    kept = pins_of(ready)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "kept.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "kept.blend"))
    np.testing.assert_array_equal(pins_of(bpy.context.scene).points, kept.points)
    assert bpy.ops.facestage.remove_pin() == {"FINISHED"}


def test_a_face_that_was_not_fitted_is_put_where_the_landmarks_are(ready, tmp_path: Path) -> None:
    import bpy

    from facestage.contract.files.storage import write_json
    from facestage_blender.pins.pinning import anchors

    _, corners, weights = anchors(ready.facestage.rig)
    shift = np.array([4.0, -3.0])
    wanted = np.einsum("mi,mix->mx", weights, faced(ready)[corners]) + shift
    path = tmp_path / "landmarks.json"
    write_json(path, {"scheme": "ibug68", "points": wanted.tolist()})
    bpy.ops.facestage.choose_landmarks(filepath=str(path))
    ready.facestage.result = ""
    assert bpy.ops.facestage.pin_face() == {"FINISHED"}
    assert ready.facestage.pinning
    background = ready.camera.data.background_images[0]
    assert background.display_depth == "FRONT"
    now = np.einsum("mi,mix->mx", weights, faced(ready)[corners])
    np.testing.assert_allclose(now, wanted, atol=0.3)
    assert bpy.ops.facestage.pin_face() == {"FINISHED"}
    assert not ready.facestage.pinning and background.display_depth == "BACK"


def test_what_cannot_be_pinned_is_said(ready, head: FaceModel) -> None:
    import bpy

    from facestage_blender.rig.face_rig import build_rig

    refused(bpy.ops.facestage.drag_pin, "There is no face under the pointer", start=(1, 1))
    bpy.ops.facestage.drag_pin(start=(48, 42), to=(49, 42))
    build_rig(ready, head, "npz:another.npz", ready.facestage.stage)
    refused(bpy.ops.facestage.drag_pin, "press Clear Pins", start=(48, 42))
    refused(bpy.ops.facestage.fit, "press Clear Pins")
    ready.facestage.pins = "{"
    refused(bpy.ops.facestage.drag_pin, "press Clear Pins", start=(48, 42))
    bpy.ops.facestage.clear_pins()
    del ready.facestage.rig.data["facestage_landmarks_ibug68"]
    refused(bpy.ops.facestage.pin_face, "press Rebuild Face Rig")


def test_handles_of_a_control_rig_stay_as_they_are(ready) -> None:
    import bpy

    from facestage_blender.pins.pinning import Pinning

    assert bpy.ops.facestage.add_control_rig() == {"FINISHED"}
    armature = ready.facestage.rig.facestage_face.control_rig
    armature.pose.bones["jaw_master"].rotation_euler.x = 0.1
    ready.view_layers[0].update()
    opened = ready.facestage.rig.data.shape_keys.key_blocks["jawOpen"].value
    assert opened > 0.05
    before = faced(ready)
    assert bpy.ops.facestage.drag_pin(start=(48, 42), to=(51, 40)) == {"FINISHED"}
    pinning = Pinning(ready)
    np.testing.assert_allclose(pinning.shown, [[51, 40]], atol=0.1)
    assert np.abs(faced(ready) - before).max() > 1
    assert armature.pose.bones["jaw_master"].rotation_euler.x == pytest.approx(0.1)
    assert bpy.ops.facestage.remove_pin() == {"FINISHED"}
    np.testing.assert_allclose(faced(ready), before, atol=1e-2)
    assert ready.facestage.rig.data.shape_keys.key_blocks["jawOpen"].value == pytest.approx(
        opened, abs=1e-4
    )
