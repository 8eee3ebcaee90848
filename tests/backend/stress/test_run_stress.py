"""Children, exit codes and the command, with a fast subset of the real cases."""

from __future__ import annotations

import io
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from facestage.cli import main
from facestage.contract.errors import InputError
from facestage.contract.job import Job
from facestage.contract.result import CONVERGED
from facestage.stress import run
from facestage.stress.case import Case
from facestage.stress.cases import CASES
from facestage.stress.child import run_case
from facestage.stress.outcome import CRASHED, HUNG, REFUSED, Outcome
from facestage.stress.run import run_in_child, run_stress
from reference.known import known

ANY = CASES["plain"]


def _child(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def test_there_are_enough_cases_and_each_says_what_it_stresses() -> None:
    assert len(CASES) >= 24
    assert all(case.about and case.name == name for name, case in CASES.items())


def test_a_case_that_outlives_its_limit_has_hung(tmp_path: Path) -> None:
    outcome = run_in_child(
        replace(ANY, seconds=0.5), tmp_path, _child("import time; time.sleep(60)")
    )
    assert outcome.kind == HUNG and outcome.seconds < 20


def test_a_child_that_dies_has_crashed_and_its_last_words_are_kept(tmp_path: Path) -> None:
    outcome = run_in_child(
        ANY, tmp_path, _child("import os; print('last words', flush=True); os.abort()")
    )
    assert outcome.kind == CRASHED
    assert "last words" in outcome.sentence and "SIGABRT" in outcome.sentence


def test_an_exception_is_a_crash_with_its_place(tmp_path: Path) -> None:
    def build(folder: Path) -> None:
        raise ZeroDivisionError("division by zero")

    outcome = run_case(Case("broken", "raises", build), tmp_path)  # type: ignore[arg-type]
    assert outcome.kind == CRASHED
    assert outcome.sentence.startswith("ZeroDivisionError: division by zero (test_run_stress.py:")


def test_a_mirrored_stage_is_one_that_a_job_may_hold(tmp_path: Path) -> None:
    # The fit takes the job as it is; what reads its result checks the stage again.
    job = CASES["lights-behind-head"].build(tmp_path)
    (tmp_path / "job").mkdir()
    job.write_into(tmp_path / "job", copy_image=False)
    behind = known(Job.load(tmp_path / "job").stage)
    assert (behind.position[:, 2] < 0).all() and (behind.direction[:, 2] > 0).all()


def test_an_input_error_is_a_refusal(tmp_path: Path) -> None:
    def build(folder: Path) -> None:
        raise InputError("The photo is empty.")

    outcome = run_case(Case("refused", "raises", build), tmp_path)  # type: ignore[arg-type]
    assert (outcome.kind, outcome.sentence) == (REFUSED, "The photo is empty.")


def test_refusals_through_the_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    names = ["one-pixel", "all-lights-off", "landmarks-at-a-point"]
    assert main(["stress", "--case", *names, "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert "3 cases" in printed and "3 refused" in printed
    assert (tmp_path / "out" / "stress.html").is_file()
    assert not (tmp_path / "out" / "cases").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["nan-and-infinity", "no-time", "everything-frozen"])
def test_a_fit_keeps_its_bounds(name: str) -> None:
    stream = io.StringIO()
    assert run_stress([name], None, stream) == 0, stream.getvalue()


def test_a_case_that_lies_fails_the_run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def lie(case: Case, folder: Path) -> Outcome:
        folder.mkdir(parents=True)
        (folder / "log.txt").write_text("all is well")
        return Outcome(
            case.name, CONVERGED, "Converged: all is well.", mm=25.0, start_mm=1.0, psnr=99.0
        )

    monkeypatch.setattr(run, "run_in_child", lie)
    stream = io.StringIO()
    assert run_stress(["plain"], tmp_path, stream) == 1
    assert "FAIL" in stream.getvalue() and "silently wrong: 25.00 mm" in stream.getvalue()
    assert (tmp_path / "cases" / "plain" / "log.txt").is_file()


def test_an_unknown_case_is_bad_input(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stress", "--case", "nonsense"]) == 2
    assert "no stress case 'nonsense'" in capsys.readouterr().err


def test_a_file_as_output_is_bad_input(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("x")
    assert main(["stress", "--out", str(tmp_path / "file")]) == 2
    assert "is a file" in capsys.readouterr().err


def test_a_folder_that_cannot_be_made_is_said_before_any_case_is_run(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("x")
    assert main(["stress", "--out", str(tmp_path / "file" / "out")]) == 2
    assert "Cannot make the folder" in capsys.readouterr().err


def test_list_names_every_case(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["stress", "--list"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == list(CASES)


def test_help_costs_no_renderer() -> None:
    code = (
        "import sys\nfrom facestage.cli import main\ntry:\n    main(['stress', '--help'])\nexcept "
        "SystemExit:\n    pass\nassert not {'mitsuba', 'numpy', 'facestage.stress'} & "
        "set(sys.modules), sorted(sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "grazing" in done.stdout
