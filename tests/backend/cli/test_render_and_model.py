"""Rendering a result again, and writing a face model."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from facestage import cli
from facestage.contract.relight_cache import RELIGHT_CACHE
from facestage.contract.result import Result
from facestage.images.image_io import read_exr
from reference.command_line import Finished, call, listing, refuse, write
from reference.synthetic_case import Case


def test_render(finished: Finished, tmp_path: Path):
    out = Path(shutil.copytree(finished[0], tmp_path / "result"))
    (out / RELIGHT_CACHE).unlink()  # nothing but a trace
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
    done = call(
        "render",
        out,
        "--out",
        tmp_path / "red.png",
        "--lights",
        lights,
        "--weights",
        weights,
        "--spp",
        "2",
    )
    assert done.returncode == 0, done.stderr
    from PIL import Image

    red = np.asarray(Image.open(tmp_path / "red.png"))
    assert red.shape == (96, 96, 3) and red[..., 0].max() > 60 and red[..., 1:].max() == 0


BAD_RENDERS: dict[str, tuple[list[str], str | None, str]] = {
    "unknown suffix": (["--out", "a.jpg"], None, ".exr or .png"),
    "no samples": (["--out", "a.png", "--spp", "0"], None, "--spp is 0"),
    "missing lights": (["--out", "a.png", "--lights", "none.json"], None, "none.json"),
    "too few lights": (
        ["--out", "a.png", "--lights", "bad.json"],
        '{"radiance": [[1, 1, 1]]}',
        "shape",
    ),
    "negative light": (
        ["--out", "a.png", "--lights", "bad.json"],
        '{"radiance": [[1,1,1],[1,1,1],[1,1,1],[-1,1,1]]}',
        "-1, expected numbers of 0 to",
    ),
    "no radiance": (["--out", "a.png", "--lights", "bad.json"], "{}", "radiance"),
    "words as light": (
        ["--out", "a.png", "--lights", "bad.json"],
        '{"radiance": "bright"}',
        "radiance",
    ),
    "unknown expression": (
        ["--out", "a.png", "--weights", "bad.json"],
        '{"expression": {"frown": 1}}',
        "frown",
    ),
    "unknown kind": (["--out", "a.png", "--weights", "bad.json"], '{"mood": {"smile": 1}}', "mood"),
    "weights as list": (
        ["--out", "a.png", "--weights", "bad.json"],
        '{"expression": [1, 2]}',
        "list",
    ),
    "word as weight": (
        ["--out", "a.png", "--weights", "bad.json"],
        '{"expression": {"smile": "x"}}',
        "smile",
    ),
    "file in place of a folder": (["--out", "bad.json/a.png"], "{}", "Cannot write"),
}


@pytest.mark.parametrize("name", BAD_RENDERS)
def test_bad_renders_are_refused(
    finished: Finished,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    name: str,
):
    arguments, content, word = BAD_RENDERS[name]
    monkeypatch.chdir(tmp_path)
    if content is not None:
        write(tmp_path / "bad.json", content)
    before = listing(tmp_path)
    assert word in refuse(capsys, "render", finished[0], *arguments)
    assert listing(tmp_path) == before


def test_render_of_what_is_no_result(
    finished: Finished, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert "does not exist" in refuse(
        capsys, "render", tmp_path / "none", "--out", tmp_path / "a.png"
    )
    (tmp_path / "empty").mkdir()
    assert "result.json" in refuse(
        capsys, "render", tmp_path / "empty", "--out", tmp_path / "a.png"
    )
    shutil.copytree(finished[0], tmp_path / "half")
    (tmp_path / "half" / "albedo.exr").unlink()
    assert "albedo.exr" in refuse(capsys, "render", tmp_path / "half", "--out", tmp_path / "a.png")


def test_model_is_written_and_summed_up(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    assert cli.main(["model", case.model_option, "--out", str(tmp_path / "copy.npz")]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["vertices"] == 529 and summary["identity"] == 4 and summary["expression"] == 3
    assert (summary["license"], summary["source"]) == ("CC0", "made for tests")
    assert (tmp_path / "copy.npz").is_file()
    assert cli.main(["model", case.model_option]) == 0
    assert json.loads(capsys.readouterr().out) == summary
    assert ".npz" in refuse(capsys, "model", case.model_option, "--out", tmp_path / "copy.zip")
    assert "flamingo" in refuse(capsys, "model", "flamingo", "--out", tmp_path / "b.npz")
    (tmp_path / "folder.npz").mkdir()
    assert "folder" in refuse(capsys, "model", case.model_option, "--out", tmp_path / "folder.npz")
