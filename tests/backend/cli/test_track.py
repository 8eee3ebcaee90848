"""``facestage track``: bad input gets one sentence and exit code 2, before anything is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.corrections import Correction, write_corrections
from facestage.images.image_io import write_png
from reference.command_line import listing, refuse


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["nothing.mp4"], "no video or folder"),
        (["EMPTY"], "holds 0 pictures"),
        (["FRAMES", "--rate", "0"], "frame rate is 0"),
        (["FRAMES", "--freeze", "pose"], "a sequence can hold identity"),
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
