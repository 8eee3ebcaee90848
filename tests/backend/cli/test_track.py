"""``facestage track``: bad input gets one sentence and exit code 2, before anything is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.cli import main
from facestage.contract.corrections import Correction, write_corrections
from facestage.contract.errors import InputError
from facestage.fit.sequence import run
from facestage.fit.sequence.request import Request
from facestage.images.image_io import write_png
from reference.command_line import listing, refuse


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["nothing.mp4"], "no video or folder"),
        (["EMPTY"], "holds 0 pictures"),
        (["FRAMES", "--rate", "0"], "frame rate is 0"),
        (["FRAMES", "--freeze", "pose"], "a sequence can hold identity"),
        (["FRAMES", "--dynamic-skin", "--landmarks-only"], "leave one of them away"),
        (["FRAMES", "--budget", "soon"], "budget is 'soon'"),
        (["FRAMES", "--camera", "nothing.json"], "nothing.json"),
        (["FRAMES", "--model", "nothing"], "nothing"),
        (["FRAMES", "--frames", "1:2"], "give that too"),
        (["FRAMES", "--corrected", "nothing.json"], "nothing.json"),
        (["FRAMES", "--corrected", "KEYS", "--frames", "2-1"], "frames are '2-1'"),
        (["FRAMES", "--corrected", "KEYS", "--resume"], "leave out --resume"),
        (["FRAMES", "--corrected", "KEYS", "--focal-px", "90"], "leave out --focal-px"),
        (["FRAMES", "--corrected", "KEYS"], "run facestage track first"),
    ],
)
def test_bad_input_is_refused(
    options: list[str], words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    frames, empty = tmp_path / "frames", tmp_path / "empty"
    frames.mkdir()
    empty.mkdir()
    for number in range(3):
        write_png(frames / f"{number}.png", np.zeros((32, 32, 3), np.uint8))
    write_corrections(tmp_path / "keys.json", [Correction(1, {"jawOpen": 0.5})])
    known = {"KEYS": str(tmp_path / "keys.json")}
    known |= {"FRAMES": str(frames), "EMPTY": str(empty), "nothing.mp4": str(tmp_path / "no.mp4")}
    before = listing(tmp_path)
    sentence = refuse(
        capsys, "track", *(known.get(word, word) for word in options), "--out", tmp_path / "out"
    )
    assert words in sentence
    assert listing(tmp_path) == before


@pytest.mark.parametrize("asked", [True, False])
def test_changing_skin_is_looked_for_where_it_is_asked_for(
    asked: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    seen: list[Request] = []

    def stop(request: Request, *_: object) -> None:
        seen.append(request)
        raise InputError("enough")

    monkeypatch.setattr(run, "track_film", stop)
    options = ["--dynamic-skin"] if asked else []
    assert main(["track", str(tmp_path), "--out", str(tmp_path / "out"), *options]) == 2
    assert [request.dynamic_skin for request in seen] == [asked]
