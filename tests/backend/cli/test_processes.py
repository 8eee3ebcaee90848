"""The command line in processes of its own: help, events, cancel, kill, resume."""

from __future__ import annotations

import signal
import time
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.events import DONE, PROGRESS, STARTED
from facestage.contract.job import Job
from facestage.contract.result import CONVERGED, Result
from reference.command_line import (
    PATIENCE,
    Finished,
    call,
    events_of,
    fit_arguments,
    one_sentence,
    start,
    wait_for_checkpoint,
)
from reference.synthetic_case import Case


@pytest.mark.parametrize(
    "command", [(), ("fit",), ("track",), ("detect",), ("render",), ("model",), ("doctor",)]
)
def test_help(command: tuple[str, ...]):
    done = call(*command, "--help")
    assert done.returncode == 0 and done.stderr == ""
    assert "usage: facestage" in done.stdout and "--help" in done.stdout


def test_version_and_no_command():
    assert call("--version").stdout.startswith("facestage ")
    done = call()
    assert done.returncode == 2 and "usage" in done.stderr and "Traceback" not in done.stderr


def test_a_fit_speaks_in_events_and_writes_a_result(finished: Finished):
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


def test_a_job_folder_gives_the_same_as_its_options(case: Case, finished: Finished, tmp_path: Path):
    Job.load(finished[0]).save(tmp_path / "job")
    done = call("fit", "--job", tmp_path / "job", "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    np.testing.assert_allclose(
        Result.load(tmp_path / "out").vertices, Result.load(finished[0]).vertices, atol=1e-7
    )


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
    case: Case, finished: Finished, tmp_path: Path
):
    process = start(*fit_arguments(case, tmp_path / "out"))
    wait_for_checkpoint(process, "geometry")
    process.kill()
    process.communicate(timeout=PATIENCE)
    assert (
        not (tmp_path / "out").exists() and (tmp_path / "out.partial" / "checkpoint.npz").is_file()
    )
    done = call(*fit_arguments(case, tmp_path / "out"), "--resume")
    assert done.returncode == 0, done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    found, wanted = Result.load(tmp_path / "out"), Result.load(finished[0])
    print(
        f"after a kill: vertices off by {1e3 * np.abs(found.vertices - wanted.vertices).max():.1e} "
        "mm"
    )
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


@pytest.mark.parametrize("seconds", [0.0, 0.05, 0.1, 0.3])
def test_cancel_while_starting(case: Case, tmp_path: Path, seconds: float):
    """Also inside an import of the renderer, which turns the signal's exception into its own."""
    # An import that is cut short leaves the file it was reading to the garbage collector.
    process = start(*fit_arguments(case, tmp_path / "out"), warnings="ignore::ResourceWarning")
    assert process.stdout is not None
    process.stdout.readline()
    time.sleep(seconds)
    process.send_signal(signal.SIGTERM)
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 3, err
    one_sentence(err)
    assert not (tmp_path / "out").exists()
