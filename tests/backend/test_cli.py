"""The command line in processes of its own: help, refusals, cancel, resume, render."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from facestage import cli
from facestage.contract.errors import BackendUnavailableError
from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.result import CONVERGED, Result
from facestage.image_io import read_exr
from reference.synthetic_case import Case, write_case
from reference.synthetic_scene import synthetic_scene

# Without the 1024 texels of the specular map and the albedo texture a fit takes seconds.
QUICK = ("--freeze", "specular", "albedo", "roughness", "--lights", "4", "--device", "cpu")
PATIENCE = 240  # seconds until a process counts as hung


def start(*arguments: str | Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "facestage.cli", *map(str, arguments)], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONWARNINGS": "error::ResourceWarning"},
    )  # fmt: skip


def call(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    process = start(*arguments)
    try:
        out, err = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    return subprocess.CompletedProcess(arguments, process.returncode, out, err)


def fit_arguments(case: Case, out: Path, extra: Sequence[str | Path] = QUICK) -> list[str | Path]:
    return ["fit", case.photo, "--landmarks", case.landmarks, "--camera", case.camera, "--model", case.model_option,
            "--out", out, *extra]  # fmt: skip


def events_of(out: str) -> list[Event]:
    events = [Event.from_line(line) for line in out.splitlines()]
    assert None not in events, f"stdout holds something else than events: {out[:500]}"
    return [event for event in events if event is not None]


def one_sentence(text: str) -> str:
    """The only line on stderr."""
    assert "Traceback" not in text, text
    lines = text.splitlines()
    assert len(lines) == 1, text
    assert lines[0].startswith("facestage: ") and len(lines[0]) > 30 and lines[0].rstrip().endswith((".", "?", "]"))
    return lines[0]


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Case:
    from facestage.render.variant import start_renderer

    start_renderer("cpu")
    return write_case(tmp_path_factory.mktemp("case"), synthetic_scene())


@pytest.fixture(scope="module")
def finished(case: Case, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    """The result folder of a fit that nothing disturbed, and what it said."""
    out = tmp_path_factory.mktemp("finished") / "out"
    return out, call(*fit_arguments(case, out))


@pytest.mark.parametrize("command", [(), ("fit",), ("detect",), ("render",), ("model",), ("doctor",)])
def test_help(command: tuple[str, ...]):
    done = call(*command, "--help")
    assert done.returncode == 0 and done.stderr == ""
    assert "usage: facestage" in done.stdout and "--help" in done.stdout


def test_version_and_no_command():
    assert call("--version").stdout.startswith("facestage ")
    done = call()
    assert done.returncode == 2 and "usage" in done.stderr and "Traceback" not in done.stderr


def test_a_fit_speaks_in_events_and_writes_a_result(finished: tuple[Path, subprocess.CompletedProcess[str]]):
    out, done = finished
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    events = events_of(done.stdout)
    assert [events[0].kind, events[-1].kind] == [STARTED, DONE]
    assert all(event.kind == PROGRESS for event in events[1:-1]) and len(events) > 8
    assert {"pose", "landmarks", "geometry", "joint"} <= {event.stage for event in events}
    assert [path.name for path in out.parent.iterdir()] == ["out"]
    result = Result.load(out)
    assert result.status == CONVERGED and result.errors["psnr"] > 25


def test_a_job_folder_gives_the_same_as_its_options(
    case: Case, finished: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path
):
    Job.load(finished[0]).save(tmp_path / "job")
    done = call("fit", "--job", tmp_path / "job", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(Result.load(tmp_path / "out").vertices, Result.load(finished[0]).vertices, atol=1e-7)


def wait_for_checkpoint(process: subprocess.Popen[str], stage: str) -> None:
    """Until the process has taken a step of ``stage``."""
    assert process.stdout is not None
    for line in process.stdout:
        event = Event.from_line(line)
        if event is not None and event.stage == stage:
            return
    pytest.fail(f"the process ended without a step of '{stage}'")


def test_cancel_keeps_the_checkpoint_and_leaves_no_result(case: Case, tmp_path: Path):
    process = start(*fit_arguments(case, tmp_path / "out"))
    wait_for_checkpoint(process, "geometry")
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 3, err
    assert "--resume" in one_sentence(err)
    assert [path.name for path in tmp_path.iterdir()] == ["out.partial"]
    assert (tmp_path / "out.partial" / "checkpoint.npz").is_file()


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs a system with kill -9")
def test_kill_and_resume_matches_the_undisturbed_run(
    case: Case, finished: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path
):
    process = start(*fit_arguments(case, tmp_path / "out"))
    wait_for_checkpoint(process, "geometry")
    process.kill()
    process.communicate(timeout=PATIENCE)
    assert not (tmp_path / "out").exists() and (tmp_path / "out.partial" / "checkpoint.npz").is_file()
    done = call(*fit_arguments(case, tmp_path / "out"), "--resume")
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    found, wanted = Result.load(tmp_path / "out"), Result.load(finished[0])
    print(f"after a kill: vertices off by {1e3 * np.abs(found.vertices - wanted.vertices).max():.1e} mm")
    np.testing.assert_allclose(found.vertices, wanted.vertices, atol=1e-7)
    np.testing.assert_allclose(found.stage.radiance, wanted.stage.radiance, rtol=1e-6)
    stages = {event.stage for event in events_of(done.stdout)}
    assert "pose" not in stages, "what was done is not done again"


def test_resume_with_other_options_is_refused(case: Case, tmp_path: Path):
    process = start(*fit_arguments(case, tmp_path / "out"))
    wait_for_checkpoint(process, "landmarks")
    process.kill()
    process.communicate(timeout=PATIENCE)
    done = call(*fit_arguments(case, tmp_path / "out"), "--resume", "--seed", "4")
    assert done.returncode == 2 and "another job" in one_sentence(done.stderr)
    assert not (tmp_path / "out").exists()


def test_a_listener_that_goes_away_is_no_crash(case: Case, tmp_path: Path):
    process = start(*fit_arguments(case, tmp_path / "out"))
    wait_for_checkpoint(process, "pose")
    assert process.stdout is not None and process.stderr is not None
    process.stdout.close()
    assert process.wait(timeout=PATIENCE) == 3
    with process.stderr as stream:
        assert "Traceback" not in stream.read()


# --- refusals: in this process, since only starting Python takes time; the real processes are above and below.


def refuse(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> str:
    """The sentence of a command that must end with exit code 2."""
    before = signal.getsignal(signal.SIGTERM)
    try:
        code = cli.main([str(argument) for argument in arguments])
    finally:
        signal.signal(signal.SIGTERM, before)
    captured = capsys.readouterr()
    assert code == 2, captured
    return one_sentence(captured.err)


def listing(folder: Path) -> list[Path]:
    return sorted(folder.rglob("*"))


def write(path: Path, content: bytes | str) -> Path:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def points(case: Case, path: Path, change: Callable[[dict], object]) -> Path:
    data = json.loads(case.landmarks.read_text())
    change(data)
    return write(path, json.dumps(data))


def nan_exr(path: Path) -> Path:
    os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"
    import cv2

    assert cv2.imwrite(str(path), np.full((8, 8, 3), np.nan, np.float32), [cv2.IMWRITE_EXR_TYPE, 2])
    return path


def shift(data: dict) -> None:
    data["points"] = [[x + 5000, y] for x, y in data["points"]]


BAD_OPTIONS: dict[str, tuple[Callable[[Case, Path], dict[str, str | Path | None]], list[str]]] = {
    "missing photo": (lambda _, d: {"image": d / "none.png"}, ["none.png", "does not exist"]),
    "text renamed .png": (lambda _, d: {"image": write(d / "t.png", "hello " * 99)}, ["t.png", "not a readable image"]),
    "text renamed .exr": (lambda _, d: {"image": write(d / "t.exr", "hello " * 99)}, ["t.exr", "OpenEXR"]),
    "empty photo": (lambda _, d: {"image": write(d / "e.png", b"")}, ["e.png", "empty"]),
    "NaN photo": (lambda _, d: {"image": nan_exr(d / "n.exr")}, ["n.exr", "no usable pixel"]),
    "folder as photo": (lambda _, d: {"image": d}, ["does not exist"]),
    "missing landmarks": (lambda _, d: {"--landmarks": d / "none.json"}, ["landmark file", "none.json", "not exist"]),
    "no landmarks": (lambda _, d: {"--landmarks": None}, ["landmarks", "--landmarks"]),
    "too few landmarks": (
        lambda c, d: {"--landmarks": points(c, d / "p.json", lambda data: data["points"].pop())},
        ["p.json", "67", "68"],
    ),
    "landmarks elsewhere": (lambda c, d: {"--landmarks": points(c, d / "p.json", shift)}, ["outside", "96 x 96"]),
    "NaN landmarks": (
        lambda c, d: {"--landmarks": points(c, d / "p.json", lambda data: data["points"].__setitem__(0, [np.nan, 1]))},
        ["p.json", "NaN"],
    ),
    "unknown scheme": (
        lambda c, d: {"--landmarks": points(c, d / "p.json", lambda data: data.update(scheme="dlib5"))},
        ["dlib5", "ibug68"],
    ),
    "scheme of another model": (
        lambda _, d: {"--landmarks": write(d / "p.json", json.dumps(
            {"scheme": "mediapipe478", "points": np.random.default_rng(0).uniform(10, 80, (478, 2)).tolist()}
        ))}, ["mediapipe478", "ibug68"],
    ),
    "landmarks that are no JSON": (lambda _, d: {"--landmarks": write(d / "p.json", "{")}, ["p.json", "JSON"]),
    "landmarks as a list": (lambda _, d: {"--landmarks": write(d / "p.json", "[1]")}, ["p.json", "list", "object"]),
    "missing camera": (lambda _, d: {"--camera": d / "none.json"}, ["camera file", "does not exist"]),
    "camera of another photo": (
        lambda _, d: {"--camera": write(d / "c.json", json.dumps(
            {"width": 640, "height": 480, "focal_px": 500, "principal_px": [320, 240]}
        ))}, ["640 x 480", "96 x 96"],
    ),
    "camera without focal length": (
        lambda _, d: {"--camera": write(d / "c.json", '{"width": 96, "height": 96}')}, ["c.json", "lacks", "focal_px"],
    ),
    "negative focal length": (lambda _, d: {"--camera": None, "--focal-px": "-5"}, ["focal_px", "-5", "positive"]),
    "focal length that is no number": (lambda _, d: {"--camera": None, "--focal-px": "nan"}, ["focal_px", "nan"]),
    "unknown model": (lambda _, d: {"--model": "flamingo:x"}, ["flamingo:x", "default", "npz:PATH"]),
    "missing model": (lambda _, d: {"--model": f"npz:{d / 'none.npz'}"}, ["face model", "none.npz", "does not exist"]),
    "missing ICT-FaceKit": (lambda _, d: {"--model": f"ict:{d / 'none'}"}, ["ICT-FaceKit", "none", "does not exist"]),
    "model that is text": (lambda _, d: {"--model": f"npz:{write(d / 'm.npz', 'text')}"}, ["m.npz"]),
    "model of other arrays": (lambda c, d: {"--model": f"npz:{c.truth}"}, ["truth.npz", "lacks"]),
    "no lights": (lambda _, d: {"--lights": "0"}, ["0 lights", "1 to"]),
    "too many lights": (lambda _, d: {"--lights": "99999"}, ["99999 lights", "10000"]),
    "unknown parameter": (lambda _, d: {"--freeze": "nose"}, ["nose", "identity"]),
    "negative budget": (lambda _, d: {"--budget": "-1"}, ["budget", "-1", "greater than 0"]),
    "zero budget": (lambda _, d: {"--budget": "0"}, ["budget", "0", "greater than 0"]),
    "negative seed": (lambda _, d: {"--seed": "-1"}, ["seed", "-1"]),
    "missing truth": (lambda _, d: {"--truth": d / "none.npz"}, ["truth file", "does not exist"]),
    "truth of another model": (lambda c, d: {"--truth": c.model}, ["truth", "model.npz"]),
    "file in place of the output": (lambda c, d: {"--out": write(d / "file", "x")}, ["is a file"]),
    "file in place of the parent": (lambda c, d: {"--out": write(d / "file", "x") / "out"}, ["Cannot write"]),
    "somebody's folder as output": (lambda c, d: {"--out": c.photo.parent}, ["not a result"]),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_OPTIONS)
def test_bad_input_is_refused_in_one_sentence(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
):
    make, words = BAD_OPTIONS[name]
    options: dict[str, str | Path | None] = {
        "image": case.photo, "--landmarks": case.landmarks, "--camera": case.camera, "--model": case.model_option,
        "--out": tmp_path / "out", "--device": "cpu",
    }  # fmt: skip
    options |= make(case, tmp_path)
    if name == "truth of another model":
        # The same file holds vertices, but of this model: take some away.
        other = tmp_path / "model.npz"
        np.savez(other, vertices=np.zeros((5, 3)))
        options["--truth"] = other
    before = listing(tmp_path), listing(case.photo.parent)
    image = options.pop("image")
    flat = [item for option, value in options.items() if value is not None for item in (option, value)]
    assert image is not None
    sentence = refuse(capsys, "fit", image, *flat)
    for word in words:
        assert word in sentence, sentence
    assert (listing(tmp_path), listing(case.photo.parent)) == before, "nothing is written"


def test_a_real_process_refuses_the_same_way(tmp_path: Path, case: Case):
    done = call(*fit_arguments(case, tmp_path / "out", ["--lights", "0"]))
    assert done.returncode == 2 and "0 lights" in one_sentence(done.stderr)
    done = call("fit", write(tmp_path / "t.png", "text"), "--landmarks", case.landmarks, "--out", tmp_path / "out")
    assert done.returncode == 2 and "t.png" in one_sentence(done.stderr)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["t.png"]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write everywhere")
def test_an_unwritable_folder_is_refused(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    tmp_path.chmod(0o500)
    try:
        assert "Cannot write" in refuse(capsys, *fit_arguments(case, tmp_path / "out"))
    finally:
        tmp_path.chmod(0o700)


@pytest.mark.parametrize(
    "arguments",
    [
        ("fit", "a.png"), ("fit", "a.png", "--out", "o", "--light-color", "pink"), ("fly",), ("render", "r"),
        ("fit", "a.png", "--out", "o", "--camera", "c", "--focal-px", "3"),
        ("fit", "a.png", "--out", "o", "--lights", "x"),
        ("fit", "a.png", "--out", "o", "--wings"),
    ],
)  # fmt: skip
def test_wrong_usage_exits_with_2(arguments: tuple[str, ...], capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as caught:
        cli.main(list(arguments))
    assert caught.value.code == 2
    assert "usage: facestage" in capsys.readouterr().err


def test_a_fit_needs_a_photo_or_a_job_and_not_both(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert "IMAGE" in refuse(capsys, "fit", "--out", tmp_path / "out")
    assert "does not exist" in refuse(capsys, "fit", "--job", tmp_path / "none", "--out", tmp_path / "out")
    job = Job(case.photo, case.model_option, Landmarks.read(case.landmarks))
    job.save(tmp_path / "job")
    for extra in (["--lights", "3"], ["--freeze", "pose"], ["--seed", "0"], ["--model", "default"]):
        sentence = refuse(capsys, "fit", "--job", tmp_path / "job", "--out", tmp_path / "out", *extra)
        assert extra[0].strip("-") in sentence
    assert not (tmp_path / "out").exists()


def test_detect_refuses_politely_what_is_no_photo(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    refuse(capsys, "detect", tmp_path / "none.png", "--out", tmp_path / "points.json")
    assert listing(tmp_path) == []


def test_no_renderer_is_exit_code_4(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    def unavailable(_device: str) -> str:
        raise BackendUnavailableError("The CPU renderer needs LLVM 19. Run: make it so.")

    monkeypatch.setattr("facestage.fit.run.start_renderer", unavailable)
    assert cli.main([str(argument) for argument in fit_arguments(case, tmp_path / "out")]) == 4
    assert "LLVM" in one_sentence(capsys.readouterr().err)
    assert listing(tmp_path) == []


# --- options that reach the job


@pytest.mark.parametrize(
    ("arguments", "attribute", "value"),
    [
        (["--lights", "7"], lambda job: len(job.stage), 7),
        (["--light-color", "uniform"], lambda job: job.light_color, "uniform"),
        (["--freeze", "pose", "--freeze", "focal"], lambda job: job.freeze, ("pose", "focal")),
        (["--budget", "12"], lambda job: job.budget_seconds, 12.0),
        (["--seed", "9"], lambda job: job.seed, 9),
        (["--device", "cpu"], lambda job: job.device, "cpu"),
        (["--model", "npz:x.npz"], lambda job: job.model, "npz:x.npz"),
        (["--focal-px", "333"], lambda job: job.camera.focal_px, 333.0),
        (["--truth", "/t.npz"], lambda job: job.truth, Path("/t.npz")),
    ],
)
def test_every_option_reaches_the_job(case: Case, arguments: list[str], attribute: Callable, value: object):
    parser = cli.build_parser()
    plain = ["fit", str(case.photo), "--out", "o"]
    assert attribute(cli._job(parser.parse_args(plain + arguments))) == value
    if "--focal-px" not in arguments:
        assert attribute(cli._job(parser.parse_args(plain))) != value
    else:
        assert cli._job(parser.parse_args(plain)).camera is None


# --- render and model


def test_render(finished: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path):
    out = finished[0]
    result = Result.load(out)
    done = call("render", out, "--out", tmp_path / "again.exr", "--spp", "4")
    assert done.returncode == 0 and done.stderr == "", done.stderr
    again, before = read_exr(tmp_path / "again.exr"), read_exr(out / "render.exr")
    assert again.shape == before.shape
    error = np.sqrt(((again - before) ** 2).mean()) / before.max()
    print(f"rendered again with fewer samples: RMS {100 * error:.2f} % of the brightest")
    assert error < 0.02

    radiance = np.zeros((len(result.stage), 3))
    radiance[1] = [12.0, 0.0, 0.0]
    lights = write(tmp_path / "lights.json", json.dumps({"radiance": radiance.tolist()}))
    weights = write(tmp_path / "weights.json", json.dumps({"expression": {"jaw_open": 1.0}}))
    done = call("render", out, "--out", tmp_path / "red.png", "--lights", lights, "--weights", weights, "--spp", "2")
    assert done.returncode == 0, done.stderr
    from PIL import Image

    red = np.asarray(Image.open(tmp_path / "red.png"))
    assert red.shape == (96, 96, 3) and red[..., 0].max() > 60 and red[..., 1:].max() == 0


BAD_RENDERS: dict[str, tuple[list[str], str | None, str]] = {
    "unknown suffix": (["--out", "a.jpg"], None, ".exr or .png"),
    "no samples": (["--out", "a.png", "--spp", "0"], None, "--spp is 0"),
    "missing lights": (["--out", "a.png", "--lights", "none.json"], None, "none.json"),
    "too few lights": (["--out", "a.png", "--lights", "bad.json"], '{"radiance": [[1, 1, 1]]}', "shape"),
    "negative light": (
        ["--out", "a.png", "--lights", "bad.json"], '{"radiance": [[1,1,1],[1,1,1],[1,1,1],[-1,1,1]]}', "0 or more",
    ),
    "no radiance": (["--out", "a.png", "--lights", "bad.json"], "{}", "radiance"),
    "words as light": (["--out", "a.png", "--lights", "bad.json"], '{"radiance": "bright"}', "radiance"),
    "unknown expression": (["--out", "a.png", "--weights", "bad.json"], '{"expression": {"frown": 1}}', "frown"),
    "unknown kind": (["--out", "a.png", "--weights", "bad.json"], '{"mood": {"smile": 1}}', "mood"),
    "weights as list": (["--out", "a.png", "--weights", "bad.json"], '{"expression": [1, 2]}', "list"),
    "word as weight": (["--out", "a.png", "--weights", "bad.json"], '{"expression": {"smile": "x"}}', "smile"),
    "file in place of a folder": (["--out", "bad.json/a.png"], "{}", "Cannot write"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD_RENDERS)
def test_bad_renders_are_refused(
    finished: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch, name: str,
):  # fmt: skip
    arguments, content, word = BAD_RENDERS[name]
    monkeypatch.chdir(tmp_path)
    if content is not None:
        write(tmp_path / "bad.json", content)
    before = listing(tmp_path)
    assert word in refuse(capsys, "render", finished[0], *arguments)
    assert listing(tmp_path) == before


def test_render_of_what_is_no_result(
    finished: tuple[Path, subprocess.CompletedProcess[str]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert "does not exist" in refuse(capsys, "render", tmp_path / "none", "--out", tmp_path / "a.png")
    (tmp_path / "empty").mkdir()
    assert "result.json" in refuse(capsys, "render", tmp_path / "empty", "--out", tmp_path / "a.png")
    shutil.copytree(finished[0], tmp_path / "half")
    (tmp_path / "half" / "albedo.exr").unlink()
    assert "albedo.exr" in refuse(capsys, "render", tmp_path / "half", "--out", tmp_path / "a.png")


def test_model_is_written_and_summed_up(case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["model", case.model_option, "--out", str(tmp_path / "copy.npz")]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["vertices"] == 529 and summary["identity"] == 4 and summary["expression"] == 3
    assert (tmp_path / "copy.npz").is_file()
    assert ".npz" in refuse(capsys, "model", case.model_option, "--out", tmp_path / "copy.zip")
    assert "flamingo" in refuse(capsys, "model", "flamingo", "--out", tmp_path / "b.npz")
    (tmp_path / "folder.npz").mkdir()
    assert "folder" in refuse(capsys, "model", case.model_option, "--out", tmp_path / "folder.npz")


@pytest.mark.parametrize("seconds", [0.0, 0.05, 0.1, 0.3])
def test_cancel_while_starting(case: Case, tmp_path: Path, seconds: float):
    """Also inside an import of the renderer, which turns the signal's exception into its own."""
    process = start(*fit_arguments(case, tmp_path / "out"))
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(seconds)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 3, err
    one_sentence(err)
    assert not (tmp_path / "out").exists()
