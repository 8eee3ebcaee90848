"""Paths that no machine has, files that never end: exit code 2 and one sentence from every command
that takes one.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from reference.command_line import listing, refuse
from reference.synthetic_case import Case

LONG, NUL = "x" * 5000, "a\0b"
COMMANDS: dict[str, list[str]] = {
    "photo": ["fit", "BAD", "--out", "OUT"],
    "fit --out": ["fit", "PHOTO", "--landmarks", "LANDMARKS", "--model", "MODEL", "--out", "BAD"],
    "fit --landmarks": ["fit", "PHOTO", "--landmarks", "BAD", "--out", "OUT"],
    "fit --camera": ["fit", "PHOTO", "--landmarks", "LANDMARKS", "--camera", "BAD", "--out", "OUT"],
    "fit --truth": [
        "fit",
        "PHOTO",
        "--landmarks",
        "LANDMARKS",
        "--model",
        "MODEL",
        "--truth",
        "BAD",
        "--out",
        "OUT",
    ],
    "fit --job": ["fit", "--job", "BAD", "--out", "OUT"],
    "fit --model": [
        "fit",
        "PHOTO",
        "--landmarks",
        "LANDMARKS",
        "--model",
        "npz:BAD",
        "--out",
        "OUT",
    ],
    "track": ["track", "BAD", "--out", "OUT"],
    "track --camera": ["track", "OUT", "--camera", "BAD", "--out", "OUT"],
    "detect": ["detect", "BAD", "--out", "OUT"],
    "detect --out": ["detect", "PHOTO", "--out", "BAD"],
    "detect --landmark-model": ["detect", "PHOTO", "--out", "OUT", "--landmark-model", "BAD"],
    "render": ["render", "BAD", "--out", "OUT.png"],
    "render --lights": ["render", "RESULT", "--lights", "BAD", "--out", "OUT.png"],
    "render --weights": ["render", "RESULT", "--weights", "BAD", "--out", "OUT.png"],
    "render --out": ["render", "RESULT", "--out", "BAD.png"],
    "model ict": ["model", "ict:BAD"],
    "model flame": ["model", "flame:BAD"],
    "model bfm": ["model", "bfm:BAD"],
    "model gnm": ["model", "gnm:BAD"],
    "model rig": ["model", "rig:BAD"],
    "model --out": ["model", "MODEL", "--out", "BAD.npz"],
    "bench --case": ["bench", "--case", "BAD", "--out", "OUT"],
    "bench --out": ["bench", "--out", "BAD"],
    "stress --out": ["stress", "--case", "profile", "--out", "BAD"],
}


def arguments(command: list[str], bad: str, case: Case, folder: Path) -> list[str]:
    known = {
        "PHOTO": case.photo,
        "LANDMARKS": case.landmarks,
        "MODEL": case.model_option,
        "RESULT": folder / "none",
        "OUT": folder / "out",
        "OUT.png": folder / "out.png",
    }
    return [str(known.get(word, word.replace("BAD", bad))) for word in command]


@pytest.mark.parametrize("bad", [LONG, NUL, "~nosuchuser/x"], ids=["long", "null", "nobody"])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_path_that_no_machine_has_is_refused(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, bad: str
):
    sentence = refuse(capsys, *arguments(COMMANDS[name], bad, case, tmp_path))
    assert sentence.isprintable() and len(sentence) < 500
    assert listing(tmp_path) == []


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes are of Unix")
@pytest.mark.parametrize(
    "name",
    [
        "fit --landmarks",
        "fit --camera",
        "fit --truth",
        "fit --model",
        "render --lights",
        "model rig",
    ],
)
@pytest.mark.parametrize("device", [False, True], ids=["pipe", "device"])
def test_a_file_that_never_ends_is_refused(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, device: bool
):
    pipe = Path("/dev/zero") if device else tmp_path / "pipe"
    if not device:
        os.mkfifo(pipe)
    sentence = refuse(capsys, *arguments(COMMANDS[name], str(pipe), case, tmp_path))
    assert "a pipe or a device" in sentence
