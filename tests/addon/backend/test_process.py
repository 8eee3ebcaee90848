"""The backend as a child process: progress, cancellation, and every way to die."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from facestage.contract.errors import BackendUnavailableError
from facestage.contract.events import Event
from facestage_blender.backend import process
from facestage_blender.backend.commands import find_backend
from facestage_blender.backend.process import BackendProcess, explain


def wait_for_first_event(child: BackendProcess) -> None:
    deadline = time.monotonic() + 60
    while not child.poll():
        assert time.monotonic() < deadline, "the stand-in said nothing"
        time.sleep(0.01)


def test_events_arrive_and_the_end_is_seen(stand_in: Callable[[str], list[str]]) -> None:
    events: list[Event] = []
    outcome = BackendProcess([*stand_in("works"), "doctor"]).wait(events.append)
    assert outcome.ok
    assert [event.kind for event in events] == ["started", "done"]
    assert events[-1].fraction == 1.0
    assert events[-1].error == 0.25


def test_a_full_pipe_does_not_stop_the_child(stand_in: Callable[[str], list[str]]) -> None:
    child = BackendProcess([*stand_in("chatty"), "doctor"])
    assert child.wait().ok
    assert child.output.endswith("everything works")


def test_refusal_is_the_backends_own_sentence(stand_in: Callable[[str], list[str]]) -> None:
    outcome = BackendProcess([*stand_in("refuses"), "fit"]).wait()
    assert (outcome.code, outcome.message) == (2, "The photo is of a cat; expected a face.")


def test_crash_is_explained_in_one_line(stand_in: Callable[[str], list[str]]) -> None:
    outcome = BackendProcess([*stand_in("crashes"), "fit"]).wait()
    assert outcome.code == 1
    assert "RuntimeError: out of luck" in outcome.message
    assert "\n" not in outcome.message


def test_kill_is_survived_and_explained(stand_in: Callable[[str], list[str]]) -> None:
    child = BackendProcess([*stand_in("hangs"), "fit"])
    wait_for_first_event(child)
    os.kill(child.pid, signal.SIGKILL)
    outcome = child.wait()
    assert outcome.code == 1
    assert "killed (SIGKILL" in outcome.message
    assert "Resume" in outcome.message


def test_cancel_stops_the_child(stand_in: Callable[[str], list[str]]) -> None:
    child = BackendProcess([*stand_in("hangs"), "fit"])
    wait_for_first_event(child)
    assert child.outcome() is None
    child.cancel()
    assert child.wait().code == process.CANCELLED


def test_a_child_that_ignores_cancel_is_killed(stand_in: Callable[[str], list[str]]) -> None:
    child = BackendProcess([*stand_in("stubborn"), "fit"], kill_after=0.2)
    wait_for_first_event(child)
    child.cancel()
    assert child.wait().code == process.CANCELLED


def test_a_command_that_does_not_exist_is_named() -> None:
    with pytest.raises(BackendUnavailableError, match="no_such_backend"):
        BackendProcess(["/no_such_backend"])


@pytest.mark.parametrize("code", [2, 3, 4, 1, 77, -11, -9, -250])
def test_every_exit_code_has_a_sentence(code: int) -> None:
    outcome = explain(code, [], "", cancelled=False)
    assert not outcome.ok
    assert outcome.message


def test_backend_is_found_where_the_user_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "my backend"
    program.write_text("#!/bin/sh\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("FACESTAGE_BACKEND", f"{sys.executable} -m facestage")
    assert find_backend(str(program)) == [str(program)]
    assert find_backend() == [sys.executable, "-m", "facestage"]
    with pytest.raises(BackendUnavailableError, match="preferences"):
        find_backend(str(tmp_path / "absent"))


def test_process_and_backend_need_no_blender() -> None:
    modules = ("backend.process", "backend.commands", "batch")
    imports = ", ".join(f"facestage_blender.{name}" for name in modules)
    code = f"import sys, {imports}; sys.exit('bpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
