"""The real backend behind the add-on: a small synthetic photo, the whole way."""

from __future__ import annotations

import os
import signal
import subprocess
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from facestage.contract.errors import BackendUnavailableError
from facestage.contract.face_model import FaceModel
from facestage.contract.files.partial import partial_folder
from facestage.contract.result import Result
from facestage_blender.backend.commands import find_backend, fit_command, model_command

if TYPE_CHECKING:
    from facestage_blender.headless.pipeline import Order

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("scene")]
SIZE = 96


@pytest.fixture(scope="module")
def backend() -> list[str]:
    try:
        return find_backend()
    except BackendUnavailableError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def case(empty_scene, backend: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A small photo of the default model's person number 7."""
    from facestage_blender.headless import pipeline
    from facestage_blender.synthetic.cases.person import random_person
    from facestage_blender.synthetic.photograph import render_person

    folder = tmp_path_factory.mktemp("person")
    pipeline.run_backend(
        model_command(backend, "default", folder / "model.npz"), lambda _event: None
    )
    model = FaceModel.load(folder / "model.npz")
    person = random_person(model, 7)
    with empty_scene() as scene:
        render_person(scene, model, person, folder / "case", samples=32, seed=7, size=SIZE)
    return folder / "case"


def order_of(case: Path, folder: Path, **more: Any) -> Order:
    """A fit of the photo with what is given beside it, into a folder's ``out``."""
    from facestage_blender.headless.pipeline import Order

    return Order(
        image=case / "photo.png",
        out=folder / "out",
        landmarks=case / "landmarks.json",
        camera=case / "camera.json",
        **more,
    )


def test_fit_is_written_back_as_the_fit_saw_it(
    case: Path, backend: list[str], tmp_path: Path
) -> None:
    from facestage_blender.headless import demo, pipeline
    from facestage_blender.pictures import render

    order = order_of(case, tmp_path, truth=case / "truth.npz", budget=40.0)
    scene = pipeline.empty_scene()
    stages: list[str] = []
    result = pipeline.fit_photo(scene, order, backend, lambda event: stages.append(event.stage))
    match = demo.agreement(scene, result, render.Crop((0, 0, SIZE, SIZE)), samples=64)
    print(f"Cycles against the fit's renderer: {match:.1f} dB, at least 32; errors {result.errors}")
    assert match >= 32.0
    assert len(set(stages)) > 2
    assert result.errors["psnr"] > 25.0
    assert result.errors["similarity_mm"] < 4.0
    assert result.folder is not None
    check_relit(scene, backend, result.folder, tmp_path)


def check_relit(scene: Any, backend: list[str], result: Path, folder: Path) -> None:
    """Under surroundings that Blender ships, Cycles sees the written-back face as the backend does:
    traced, and as a sum of one-light pictures.
    """
    from facestage_blender.pictures.render import read_pixels, render_linear, save_exr
    from facestage_blender.synthetic.scans.light import light_world, read_surroundings

    for item in scene.objects:
        if item.type == "LIGHT":
            item.hide_render = True
    light = read_surroundings("interior@70")
    light_world(scene, light, vertical="Z")
    save_exr(folder / "map.exr", read_pixels(light.file)[..., :3])
    cycles = render_linear(scene, 128)
    field = folder / "field"
    for command in (
        ["reflectance", result, "--out", field, "--directions", "100"],
        ["render", field, "--environment", f"{folder / 'map.exr'}@70", "--out", folder / "sum.exr"],
        ["render", result, "--environment", f"{folder / 'map.exr'}@70", "--out", folder / "l.exr"],
    ):
        done = subprocess.run([*backend, *map(str, command)], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    for name, least in (("sum.exr", 30.0), ("l.exr", 30.0)):
        ours = read_pixels(folder / name)[..., :3]
        face = (cycles[..., 3] > 0.999) & (ours.max(axis=2) > 0)
        difference = np.clip(ours, 0, 1)[face] - np.clip(cycles[..., :3], 0, 1)[face]
        match = float(-10 * np.log10((difference**2).mean()))
        print(f"Cycles under 'interior' against {name}: {match:.1f} dB, at least {least}")
        assert match >= least


@pytest.mark.parametrize("name", ["scattering", "translucency"])
def test_light_below_the_skin_is_written_back_as_the_fit_saw_it(
    case: Path, backend: list[str], tmp_path: Path, name: str
) -> None:
    """By a random walk in Cycles, or nodes, by the fit's own formulas in its render."""
    import bpy

    from facestage_blender.backend.process import BackendProcess
    from facestage_blender.exchange.scene_read import read_job
    from facestage_blender.exchange.write_back import apply_result
    from facestage_blender.headless import demo, pipeline
    from facestage_blender.pictures import render

    order = order_of(case, tmp_path)
    scene = pipeline.empty_scene()
    pipeline.prepare_scene(scene, order, backend, lambda _event: None)
    job, out = tmp_path / "job", tmp_path / "result"
    given = read_job(scene)
    initial = {**given.initial, name: np.array(1.0)}
    # With the mean face and its own maps, which show light below the skin as well as any.
    freeze = name, "specular", "roughness", "albedo", "identity", "expression"
    replace(given, freeze=freeze, initial=initial, quality="draft").save(job)
    assert BackendProcess(fit_command(backend, [job], out)).wait().ok
    result = Result.load(out)
    apply_result(scene, result)
    group = bpy.data.materials["Facestage Skin"].node_tree.nodes["Facestage Skin"]
    assert group.inputs["Subsurface"].default_value == float(name == "scattering")
    assert group.inputs[name.capitalize()].default_value == 1.0
    match = demo.agreement(scene, result, render.Crop((0, 0, SIZE, SIZE)), samples=512)
    print(f"Cycles' {name} against the fit's renderer: {match:.1f} dB, at least 32")
    assert match >= 32.0


def test_killed_fit_is_resumed(case: Path, backend: list[str], tmp_path: Path) -> None:
    from facestage_blender.backend.process import BackendProcess
    from facestage_blender.exchange.scene_read import read_job
    from facestage_blender.headless import pipeline

    order = order_of(case, tmp_path)
    scene = pipeline.empty_scene()
    pipeline.prepare_scene(scene, order, backend, lambda _event: None)
    job, out = tmp_path / "out" / "job", tmp_path / "out" / "result"
    # Without the maps, which take most of the time.
    replace(read_job(scene), freeze=("specular", "albedo", "roughness"), quality="draft").save(job)
    child = BackendProcess(fit_command(backend, [job], out))
    deadline = time.monotonic() + 120
    while not any(event.stage == "geometry" for event in child.poll()):
        assert child.outcome() is None
        assert time.monotonic() < deadline
        time.sleep(0.05)
    os.kill(child.pid, signal.SIGKILL)
    assert "killed" in child.wait().message
    assert not out.exists()
    assert partial_folder(out).is_dir()
    assert BackendProcess(fit_command(backend, [job], out, resume=True)).wait().ok
    assert np.isfinite(Result.load(out).vertices).all()
    assert not partial_folder(out).exists()


def test_the_face_of_a_real_photo_is_found(
    scene, backend: list[str], shared_data: Path, tmp_path: Path, monkeypatch
):
    import bpy
    import cv2
    import skimage.data

    from facestage.contract.landmarks import Landmarks
    from facestage_blender.headless.demo import SHIPPED_LANDMARKS
    from facestage_blender.landmarks.editing import read_landmarks
    from facestage_blender.landmarks.scheme import MEDIAPIPE_AS_IBUG

    monkeypatch.setenv("FACESTAGE_DATA", str(shared_data))
    photo, empty = tmp_path / "astronaut.png", tmp_path / "gray.png"
    assert cv2.imwrite(str(photo), skimage.data.astronaut()[..., ::-1])
    assert cv2.imwrite(str(empty), np.full((200, 300, 3), 128, np.uint8))
    scene.facestage.output = str(tmp_path / "work")
    bpy.ops.facestage.choose_photo(filepath=str(photo))
    scene.facestage.face_number = 2
    with pytest.raises(RuntimeError, match="one face was found"):
        bpy.ops.facestage.detect_landmarks()
    scene.facestage.face_number = 1
    assert bpy.ops.facestage.detect_landmarks() == {"FINISHED"}
    found, known = read_landmarks(scene, 512, 512), Landmarks.read(SHIPPED_LANDMARKS)
    assert found is not None
    inner = slice(17, 68)  # the jaws of the two schemes are not quite the same
    off = np.linalg.norm(found.points[list(MEDIAPIPE_AS_IBUG)] - known.points, axis=1)[inner]
    print(
        f"landmarks off by {np.median(off):.2f} px in the middle, at most {off.max():.2f}, of "
        "a face 107 px wide"
    )
    assert np.median(off) < 3
    assert off.max() < 9
    bpy.ops.facestage.choose_photo(filepath=str(empty))
    with pytest.raises(RuntimeError, match="No face was found"):
        bpy.ops.facestage.detect_landmarks()
    assert scene.facestage.landmarks == ""


@pytest.mark.parametrize(
    ("level", "turn"),
    [(0, 0.0), (1, np.pi / 2), (2, 0.0)],
    ids=["upright", "smoother, lying", "smoothest, upright"],
)
def test_a_monkey_is_not_used_as_a_face(
    scene, backend: list[str], tmp_path: Path, turn: float, level: int
) -> None:
    """Suzanne as people add her: as she is, and subdivided."""
    import bpy

    scene.facestage.output = str(tmp_path / "work")
    bpy.ops.mesh.primitive_monkey_add(rotation=(turn, 0.0, 0.0))
    monkey = bpy.context.object
    if level:
        monkey.modifiers.new("Subdivision", "SUBSURF").levels = level
        bpy.ops.object.modifier_apply(modifier="Subdivision")
    with pytest.raises(RuntimeError, match=r"No face was found on the mesh.*mark some landmarks"):
        bpy.ops.facestage.use_my_mesh()
    assert not monkey.facestage_face.is_rig and scene.facestage.rig is None
    assert not monkey.material_slots
