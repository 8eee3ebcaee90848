"""The headless entry: whole runs with the stand-in backend, and every bad input."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

import facestage_blender
from facestage.contract.job import Job
from facestage_blender.headless import batch


@pytest.fixture
def run(scene, stand_in, capfd: pytest.CaptureFixture[str]) -> Callable[..., tuple[int, str]]:
    """Run the batch command in this process; returns the exit code and stderr."""
    stand_in("works")

    def call(*arguments: object) -> tuple[int, str]:
        capfd.readouterr()
        try:
            code = batch.main([str(argument) for argument in arguments])
        except SystemExit as leaving:
            code = int(leaving.code or 0)
        return code, capfd.readouterr().err

    return call


def test_several_photos_of_a_person_share_a_scene(
    run, photo: Path, landmark_file: Path, tmp_path: Path
) -> None:
    import shutil

    import bpy

    other, out = tmp_path / "other.png", tmp_path / "out"
    shutil.copyfile(photo, other)
    points = [landmark_file, landmark_file]
    code, said = run("--image", photo, other, "--landmarks", *points, "--out", out, "--lights", 6)
    assert code == 0, said
    assert sorted(path.name for path in out.iterdir()) == [
        "job_1",
        "job_2",
        "result",
        "scene.blend",
    ]
    bpy.ops.wm.open_mainfile(filepath=str(out / "scene.blend"))
    listed = bpy.context.scene.facestage.photos
    assert [Path(each.photo).name for each in listed] == [photo.name, other.name]
    assert all(each.result and each.landmarks for each in listed)
    code, said = run("--image", photo, other, "--landmarks", landmark_file, "--out", out)
    assert code == 2 and "--landmarks names 1 files for 2 photos" in said


def test_what_is_not_fitted_is_added_on_request(
    run, photo: Path, landmark_file: Path, tmp_path: Path
) -> None:
    import bpy

    out = tmp_path / "out"
    line = ["--image", photo, "--landmarks", landmark_file, "--out", out, "--lights", 3, "--add"]
    code, said = run(*line, "pores", "handles")
    assert code == 0, said
    bpy.ops.wm.open_mainfile(filepath=str(out / "scene.blend"))
    from facestage_blender.skin.pores import pores_of

    rig = bpy.context.scene.facestage.rig
    assert pores_of(rig) is not None
    assert rig.facestage_face.control_rig is not None
    # The small test face has no lids: the fit is saved all the same.
    (out / "scene.blend").unlink()
    code, said = run(*line, "lashes")
    assert code == 2 and "where this rig's lids are" in said
    assert (out / "scene.blend").is_file()
    code, said = run(*line, "moustache")
    assert code == 2 and "moustache" in said


def test_whole_run_saves_a_scene_that_opens_again(
    run, photo: Path, landmark_file: Path, tmp_path: Path
) -> None:
    import bpy

    out = tmp_path / "out"
    code, said = run(
        "--image",
        photo,
        "--landmarks",
        landmark_file,
        "--out",
        out,
        "--lights",
        6,
        "--skin-tone",
        "brown",
        "--relight",
        "left",
        "top",
        "--expression",
        "jawOpen=0.8",
        "--resolution",
        32,
        "--samples",
        2,
        "--export",
        out / "me.glb",
        "--export",
        out / "me.obj",
    )
    assert code == 0, said
    assert sorted(path.name for path in out.iterdir()) == [
        "expression.png",
        "job",
        "me.glb",
        "me.mtl",
        "me.obj",
        "me_textures",
        "relit_left.png",
        "relit_top.png",
        "result",
        "scene.blend",
    ]
    bpy.ops.wm.open_mainfile(filepath=str(out / "scene.blend"))
    scene = bpy.context.scene
    assert scene.facestage.rig.facestage_face.albedo_image.packed_file is not None
    assert len([item for item in scene.objects if item.type == "LIGHT"]) == 6
    assert scene.render.resolution_x == 96
    assert Job.load(out / "job").skin_tone == -10


def test_without_landmarks_the_fit_finds_them(run, photo: Path, tmp_path: Path) -> None:
    import bpy

    from facestage.contract.job import Job
    from facestage_blender.landmarks.empties import landmark_empties

    out = tmp_path / "out"
    code, said = run("--image", photo, "--face", 2, "--out", out, "--lights", 3)
    assert code == 0, said
    job = Job.load(out / "job")
    assert (job.landmarks, job.face) == (None, 2)
    bpy.ops.wm.open_mainfile(filepath=str(out / "scene.blend"))
    assert bpy.context.scene.facestage.landmarks_from == "DETECTED"
    assert bpy.ops.facestage.edit_landmarks() == {"FINISHED"}
    assert len(landmark_empties(bpy.context.scene)) == 73


def test_runs_as_a_module(stand_in, photo: Path, landmark_file: Path, tmp_path: Path) -> None:
    stand_in("works")
    command = [sys.executable, "-m", "facestage_blender.batch"]
    options = [
        "--image",
        photo,
        "--landmarks",
        landmark_file,
        "--out",
        tmp_path / "out",
        "--lights",
        "3",
    ]
    done = subprocess.run(
        [*command, *map(str, options)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "scene.blend" in done.stdout


def test_runs_by_its_path_as_blender_does(photo: Path) -> None:
    script = Path(facestage_blender.__file__).parent / "batch.py"
    done = subprocess.run(
        [sys.executable, "-I", str(script), "--", "--image", "absent.png", "--out", "x"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "'absent.png' does not exist" in done.stderr


def bad_inputs(folder: Path) -> dict[str, tuple[list[object], str]]:
    text, empty = folder / "text.png", folder / "empty.png"
    text.write_text("hello", encoding="utf-8")
    empty.write_bytes(b"")
    few, outside, camera, blocked = (
        folder / name for name in ("few.json", "outside.json", "camera.json", "blocked")
    )
    few.write_text('{"scheme": "ibug68", "points": [[1, 2], [3, 4]]}', encoding="utf-8")
    outside.write_text(f'{{"scheme": "ibug68", "points": {[[5000, 5000]] * 68}}}', encoding="utf-8")
    camera.write_text(
        '{"width": 10, "height": 10, "focal_px": 20, "principal_px": [5, 5]}', encoding="utf-8"
    )
    blocked.write_text("a file where a folder should be", encoding="utf-8")
    return {
        "photo missing": (["--image", folder / "absent.png"], "does not exist"),
        "photo is text": (["--image", text], "cannot be read|holds no picture"),
        "photo is empty": (["--image", empty], "cannot be read|holds no picture"),
        "landmarks missing": (["--landmarks", folder / "absent.json"], "does not exist"),
        "landmarks of the wrong count": (["--landmarks", few], "68"),
        "landmarks outside the photo": (["--landmarks", outside], "outside"),
        "camera of another photo": (["--camera", camera], "10 x 10"),
        "two cameras": (["--camera", camera, "--focal-px", "100"], "not allowed"),
        "no such side": (["--relight", "behind"], "invalid choice"),
        "expression without value": (["--expression", "jawOpen"], "NAME=VALUE"),
        "unknown frozen parameter": (["--freeze", "hair"], "invalid choice"),
        "no such face": (["--face", "0"], "largest face"),
        "face and landmarks": (["--face", "2", "--landmarks", few], "not allowed"),
        "negative budget": (["--budget", "-3"], "greater than 0"),
        "no such skin": (["--skin-tone", "pale"], "expected an individual typology angle"),
        "no lights": (["--lights", "0"], "0 lights"),
        "output is a file": (["--out", blocked / "deeper"], "Cannot write"),
        "truth missing": (["--truth", folder / "absent.npz"], "truth"),
        "export to no known format": (["--export", folder / "me.stl"], "ends in one of"),
        "textures of no size": (["--texture-size", "4"], "16 to 8192"),
    }


BAD_INPUTS = (
    "export to no known format",
    "textures of no size",
    "photo missing",
    "photo is text",
    "photo is empty",
    "landmarks missing",
    "landmarks of the wrong count",
    "landmarks outside the photo",
    "camera of another photo",
    "two cameras",
    "no such side",
    "expression without value",
    "unknown frozen parameter",
    "no such face",
    "face and landmarks",
    "negative budget",
    "no such skin",
    "no lights",
    "output is a file",
    "truth missing",
)


@pytest.mark.parametrize("case", BAD_INPUTS)
def test_bad_input_exits_2_with_one_sentence(run, case: str, photo: Path, tmp_path: Path) -> None:
    extra, expected = bad_inputs(tmp_path)[case]
    out = tmp_path / "out"
    code, said = run("--image", photo, "--out", out, *extra)
    lines = [line for line in said.splitlines() if line.startswith("facestage:")]
    assert code == 2, said
    assert len(lines) == 1
    assert re.search(expected, lines[0]), lines[0]
    assert "Traceback" not in said
    assert not (out / "scene.blend").exists()


def test_backends_refusal_and_absence_have_their_codes(
    run, stand_in, photo, tmp_path, monkeypatch
) -> None:
    stand_in("refuses")
    code, said = run("--image", photo, "--out", tmp_path / "out")
    assert code == 2
    assert "photo is of a cat" in said
    monkeypatch.setenv("FACESTAGE_BACKEND", "/no/such/program")
    assert run("--image", photo, "--out", tmp_path / "out")[0] == 4
