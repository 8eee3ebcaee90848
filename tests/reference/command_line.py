"""Runs the command line as another program would, and says what it did."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from facestage import cli
from facestage.contract.events import Event
from reference.synthetic_case import Case

Finished = tuple[Path, subprocess.CompletedProcess[str]]
# Without the 1024 texels of the specular map and the albedo texture a fit takes seconds.
QUICK = ("--freeze", "specular", "albedo", "roughness", "--lights", "4", "--device", "cpu")
PATIENCE = 240  # seconds until a process counts as hung


def start(
    *arguments: str | Path, warnings: str = "error::ResourceWarning"
) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "facestage.cli", *map(str, arguments)],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONWARNINGS": warnings},
    )


def call(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    process = start(*arguments)
    try:
        out, err = process.communicate(timeout=PATIENCE)
    finally:
        process.kill()
    return subprocess.CompletedProcess(arguments, process.returncode, out, err)


def fit_arguments(case: Case, out: Path, extra: Sequence[str | Path] = QUICK) -> list[str | Path]:
    return [
        "fit",
        case.photo,
        "--landmarks",
        case.landmarks,
        "--camera",
        case.camera,
        "--model",
        case.model_option,
        "--out",
        out,
        *extra,
    ]


def events_of(out: str) -> list[Event]:
    events = [Event.from_line(line) for line in out.splitlines()]
    assert None not in events, f"stdout holds something else than events: {out[:500]}"
    return [event for event in events if event is not None]


def one_sentence(text: str) -> str:
    """The only line on stderr."""
    assert "Traceback" not in text, text
    lines = text.splitlines()
    assert len(lines) == 1, text
    assert (
        lines[0].startswith("facestage: ")
        and len(lines[0]) > 30
        and lines[0].rstrip().endswith((".", "?", "]"))
    )
    return lines[0]


def wait_for_checkpoint(process: subprocess.Popen[str], stage: str) -> None:
    """Until the process has taken a step of ``stage``."""
    assert process.stdout is not None
    for line in process.stdout:
        event = Event.from_line(line)
        if event is not None and event.stage == stage:
            return
    pytest.fail(f"the process ended without a step of '{stage}'")


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
