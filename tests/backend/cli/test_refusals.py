"""Bad input of every kind: exit code 2, one sentence, nothing written."""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from facestage import cli
from facestage.contract.errors import BackendUnavailableError
from facestage.contract.face_model import FaceModel
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from reference.command_line import call, fit_arguments, listing, one_sentence, refuse, write
from reference.synthetic_case import Case


def points(case: Case, path: Path, change: Callable[[dict], object]) -> Path:
    data = json.loads(case.landmarks.read_text())
    change(data)
    return write(path, json.dumps(data))


def nan_exr(path: Path) -> Path:
    os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
    import cv2

    assert cv2.imwrite(str(path), np.full((8, 8, 3), np.nan, np.float32), [cv2.IMWRITE_EXR_TYPE, 2])
    return path


def unmarked(case: Case, path: Path) -> str:
    replace(FaceModel.load(case.model), landmarks={}).save(path)
    return f"npz:{path}"


def shift(data: dict) -> None:
    data["points"] = [[x + 5000, y] for x, y in data["points"]]


BAD_OPTIONS: dict[str, tuple[Callable[[Case, Path], dict[str, str | Path | None]], list[str]]] = {
    "missing photo": (lambda _, d: {"image": d / "none.png"}, ["none.png", "does not exist"]),
    "text renamed .png": (
        lambda _, d: {"image": write(d / "t.png", "hello " * 99)},
        ["t.png", "not a readable image (it is of no known format, or damaged)"],
    ),
    "text renamed .exr": (
        lambda _, d: {"image": write(d / "t.exr", "hello " * 99)},
        ["t.exr", "OpenEXR"],
    ),
    "empty photo": (lambda _, d: {"image": write(d / "e.png", b"")}, ["e.png", "empty"]),
    "NaN photo": (lambda _, d: {"image": nan_exr(d / "n.exr")}, ["n.exr", "no usable pixel"]),
    "folder as photo": (lambda _, d: {"image": d}, ["is a folder", "expected a file"]),
    "missing landmarks": (
        lambda _, d: {"--landmarks": d / "none.json"},
        ["landmark file", "none.json", "not exist"],
    ),
    "face that is not counted from 1": (
        lambda _, d: {"--landmarks": None, "--face": "0"},
        ["face is 0", "1"],
    ),
    "missing landmark model": (
        lambda _, d: {"--landmarks": None, "--landmark-model": d / "none.task"},
        ["none.task", "does not exist"],
    ),
    "too few landmarks": (
        lambda c, d: {"--landmarks": points(c, d / "p.json", lambda data: data["points"].pop())},
        ["p.json", "67", "68"],
    ),
    "landmarks elsewhere": (
        lambda c, d: {"--landmarks": points(c, d / "p.json", shift)},
        ["outside", "96 x 96"],
    ),
    "NaN landmarks": (
        lambda c, d: {
            "--landmarks": points(
                c, d / "p.json", lambda data: data["points"].__setitem__(0, [np.nan, 1])
            )
        },
        ["p.json", "NaN"],
    ),
    "unknown scheme": (
        lambda c, d: {
            "--landmarks": points(c, d / "p.json", lambda data: data.update(scheme="dlib5"))
        },
        ["dlib5", "ibug68"],
    ),
    "model without landmarks": (
        lambda c, d: {"--model": unmarked(c, d / "m.npz")},
        ["landmarks", "ibug68", "none"],
    ),
    "landmarks that are no JSON": (
        lambda _, d: {"--landmarks": write(d / "p.json", "{")},
        ["p.json", "JSON"],
    ),
    "landmarks as a list": (
        lambda _, d: {"--landmarks": write(d / "p.json", "[1]")},
        ["p.json", "list", "object"],
    ),
    "missing camera": (
        lambda _, d: {"--camera": d / "none.json"},
        ["camera file", "does not exist"],
    ),
    "camera of another photo": (
        lambda _, d: {
            "--camera": write(
                d / "c.json",
                json.dumps(
                    {"width": 640, "height": 480, "focal_px": 500, "principal_px": [320, 240]}
                ),
            )
        },
        ["640 x 480", "96 x 96"],
    ),
    "camera without focal length": (
        lambda _, d: {"--camera": write(d / "c.json", '{"width": 96, "height": 96}')},
        ["c.json", "lacks", "focal_px"],
    ),
    "negative focal length": (
        lambda _, d: {"--camera": None, "--focal-px": "-5"},
        ["focal_px", "-5", "positive"],
    ),
    "focal length that is no number": (
        lambda _, d: {"--camera": None, "--focal-px": "nan"},
        ["focal_px", "nan"],
    ),
    "unknown model": (
        lambda _, d: {"--model": "flamingo:x"},
        ["flamingo:x", "default", "npz:PATH"],
    ),
    "missing model": (
        lambda _, d: {"--model": f"npz:{d / 'none.npz'}"},
        ["face model", "none.npz", "does not exist"],
    ),
    "missing ICT-FaceKit": (
        lambda _, d: {"--model": f"ict:{d / 'none'}"},
        ["ICT-FaceKit", "none", "does not exist"],
    ),
    "model that is text": (
        lambda _, d: {"--model": f"npz:{write(d / 'm.npz', 'text')}"},
        ["m.npz"],
    ),
    "model of other arrays": (lambda c, d: {"--model": f"npz:{c.truth}"}, ["truth.npz", "lacks"]),
    "no lights": (lambda _, d: {"--lights": "0"}, ["0 lights", "1 to"]),
    "too many lights": (lambda _, d: {"--lights": "99999"}, ["99999 lights", "10000"]),
    "unknown parameter": (lambda _, d: {"--freeze": "nose"}, ["nose", "identity"]),
    "negative budget": (lambda _, d: {"--budget": "-1"}, ["budget", "-1", "greater than 0"]),
    "zero budget": (lambda _, d: {"--budget": "0"}, ["budget", "0", "greater than 0"]),
    "negative seed": (lambda _, d: {"--seed": "-1"}, ["seed", "-1"]),
    "missing truth": (lambda _, d: {"--truth": d / "none.npz"}, ["truth file", "does not exist"]),
    "truth of another model": (lambda c, d: {"--truth": c.model}, ["truth", "model.npz"]),
    "face region without a scan": (
        lambda c, d: {"--face-region": c.truth},
        ["--face-region", "no scan was given"],
    ),
    "face region of no scan": (
        lambda c, d: {"--truth": c.truth, "--face-region": c.truth},
        ["face region was given", "no scan"],
    ),
    "file in place of the output": (lambda c, d: {"--out": write(d / "file", "x")}, ["is a file"]),
    "file in place of the parent": (
        lambda c, d: {"--out": write(d / "file", "x") / "out"},
        ["Cannot write"],
    ),
    "somebody's folder as output": (lambda c, d: {"--out": c.photo.parent}, ["not a result"]),
}


@pytest.mark.parametrize("name", BAD_OPTIONS)
def test_bad_input_is_refused_in_one_sentence(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
):
    make, words = BAD_OPTIONS[name]
    options: dict[str, str | Path | None] = {
        "image": case.photo,
        "--landmarks": case.landmarks,
        "--camera": case.camera,
        "--model": case.model_option,
        "--out": tmp_path / "out",
        "--device": "cpu",
    }
    options |= make(case, tmp_path)
    if name == "truth of another model":
        # The same file holds vertices, but of this model: take some away.
        other = tmp_path / "model.npz"
        np.savez(other, vertices=np.zeros((5, 3)))
        options["--truth"] = other
    before = listing(tmp_path), listing(case.photo.parent)
    image = options.pop("image")
    flat = [
        item for option, value in options.items() if value is not None for item in (option, value)
    ]
    assert image is not None
    sentence = refuse(capsys, "fit", image, *flat)
    for word in words:
        assert word in sentence, sentence
    assert (listing(tmp_path), listing(case.photo.parent)) == before, "nothing is written"


def test_a_real_process_refuses_the_same_way(tmp_path: Path, case: Case):
    done = call(*fit_arguments(case, tmp_path / "out", ["--lights", "0"]))
    assert done.returncode == 2 and "0 lights" in one_sentence(done.stderr)
    done = call(
        "fit",
        write(tmp_path / "t.png", "text"),
        "--landmarks",
        case.landmarks,
        "--out",
        tmp_path / "out",
    )
    assert done.returncode == 2 and "t.png" in one_sentence(done.stderr)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.png"]


@pytest.mark.skipif(
    not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere"
)
def test_an_unwritable_folder_is_refused(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    tmp_path.chmod(0o500)
    try:
        assert "Cannot write" in refuse(capsys, *fit_arguments(case, tmp_path / "out"))
    finally:
        tmp_path.chmod(0o700)


@pytest.mark.parametrize(
    "arguments",
    [
        ("fit", "a.png"),
        ("fit", "a.png", "--out", "o", "--light-color", "pink"),
        ("fly",),
        ("render",),
        ("fit", "a.png", "--out", "o", "--camera", "c", "--focal-px", "3"),
        ("fit", "a.png", "--out", "o", "--lights", "x"),
        ("fit", "a.png", "--out", "o", "--wings"),
    ],
)
def test_wrong_usage_exits_with_2(arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as caught:
        cli.main(list(arguments))
    assert caught.value.code == 2
    assert "usage: facestage" in capsys.readouterr().err


def test_a_fit_needs_a_photo_or_a_job_and_not_both(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert "IMAGE" in refuse(capsys, "fit", "--out", tmp_path / "out")
    assert "does not exist" in refuse(
        capsys, "fit", "--job", tmp_path / "none", "--out", tmp_path / "out"
    )
    job = Job(case.photo, case.model_option, Landmarks.read(case.landmarks))
    job.save(tmp_path / "job")
    for extra in (["--lights", "3"], ["--freeze", "pose"], ["--seed", "0"], ["--model", "default"]):
        sentence = refuse(
            capsys, "fit", "--job", tmp_path / "job", "--out", tmp_path / "out", *extra
        )
        assert extra[0].strip("-") in sentence
    assert not (tmp_path / "out").exists()


def test_a_photo_without_landmarks_needs_the_landmark_model(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    def offline(*_arguments: object, **_options: object) -> NoReturn:
        raise ConnectionError

    monkeypatch.delenv("FACESTAGE_LANDMARK_MODEL", raising=False)
    for place in ("FACESTAGE_CACHE", "FACESTAGE_DATA"):
        monkeypatch.setenv(place, str(tmp_path / "none"))
    monkeypatch.setattr("pooch.retrieve", offline)
    for command, out in (("fit", tmp_path / "out"), ("detect", tmp_path / "points.json")):
        sentence = refuse(capsys, command, case.photo, "--out", out)
        assert "face_landmarker.task" in sentence and "--landmarks" in sentence
    assert listing(tmp_path) == []


def test_detect_refuses_politely_what_is_no_photo(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    refuse(capsys, "detect", tmp_path / "none.png", "--out", tmp_path / "points.json")
    assert listing(tmp_path) == []


def test_no_renderer_is_exit_code_4(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    def unavailable(_device: str) -> str:
        raise BackendUnavailableError("The CPU renderer needs LLVM 19. Run: make it so.")

    monkeypatch.setattr("facestage.fit.result.run.start_renderer", unavailable)
    assert cli.main([str(argument) for argument in fit_arguments(case, tmp_path / "out")]) == 4
    assert "LLVM" in one_sentence(capsys.readouterr().err)
    assert listing(tmp_path) == []
