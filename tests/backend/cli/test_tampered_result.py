"""Rendering a result whose files say what cannot be."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.files.storage import read_arrays
from reference.command_line import Finished, listing, refuse


def spoiled(
    finished: Finished, tmp_path: Path, arrays: dict | None = None, **values: object
) -> Path:
    folder = Path(shutil.copytree(finished[0], tmp_path / "result"))
    data = json.loads((folder / "result.json").read_text())
    (folder / "result.json").write_text(json.dumps(data | values))
    if arrays is not None:
        np.savez(folder / "result.npz", **(read_arrays(folder / "result.npz", "arrays") | arrays))
    return folder


@pytest.mark.parametrize(
    ("width", "height", "words"),
    [
        (65536, 65536, "camera.width is 65536, expected a whole number of 1 to 16384"),
        (16384, 16384, "268 million pixels; expected at most 134 million"),
    ],
)
def test_a_picture_of_gigabytes_is_refused(
    finished: Finished,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    width: int,
    height: int,
    words: str,
):
    camera = {"width": width, "height": height, "focal_px": 100.0, "principal_px": [1.0, 1.0]}
    folder = spoiled(finished, tmp_path, camera=camera)
    before = listing(tmp_path)
    assert words in refuse(capsys, "render", folder, "--out", tmp_path / "a.png")
    assert words in refuse(capsys, "render", folder, "--cache")
    assert listing(tmp_path) == before


def test_a_picture_beyond_this_machines_memory_is_refused(
    finished: Finished,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
):
    folder = spoiled(finished, tmp_path)
    (folder / "relight.npz").unlink(missing_ok=True)
    monkeypatch.setattr("facestage.fit.result.relight.machine_memory", lambda: 100_000)
    sentence = refuse(capsys, "render", folder, "--out", tmp_path / "a.png")
    assert "96 x 96 pixels" in sentence and "97.66 KiB" in sentence


def test_a_result_of_another_model_is_refused(
    finished: Finished, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    arrays = read_arrays(finished[0] / "result.npz", "arrays")
    folder = spoiled(finished, tmp_path, {"albedo": np.zeros(len(arrays["albedo"]) + 1)})
    (folder / "relight.npz").unlink(missing_ok=True)
    assert "run the fit again" in refuse(capsys, "render", folder, "--out", tmp_path / "a.png")
