"""Runs the cases one after another, each in a child process with a time limit, judges and reports
them.
"""

from __future__ import annotations

import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TextIO

from facestage.contract.errors import FacestageError, InputError
from facestage.report.stress import (
    StressRow,
    head_lines,
    make_folder,
    row_lines,
    summary_line,
    write_stress_report,
)
from facestage.stress.case import Case
from facestage.stress.cases import CASES
from facestage.stress.child import OUTCOME
from facestage.stress.outcome import CRASHED, HUNG, Outcome, Verdict, judge
from facestage.system.child import python_module

EXIT_PASSED, EXIT_FAILED = 0, 1
LOG = "log.txt"
LAST_WORDS = 200  # characters of a crashed case's log that the table shows


def run_stress(names: Sequence[str], out: Path | None, stream: TextIO) -> int:
    """Run the named cases (all when empty), print a line as each ends, and return the exit code.

    ``out``: a folder for the table as text, HTML and JSON; the files of failed cases stay in its
    ``cases``.
    """
    cases = select(names)
    if out is not None and out.exists() and not out.is_dir():
        raise InputError(f"The output '{out}' is a file; expected a folder name.")
    if out is not None:
        make_folder(out)
    _print(stream, head_lines())
    rows = []
    with tempfile.TemporaryDirectory(prefix="facestage-stress-") as temporary:
        for case in cases:
            folder = Path(temporary) / case.name
            verdict = judge(case, run_in_child(case, folder))
            rows.append(table_row(verdict))
            _print(stream, row_lines(rows[-1]))
            if out is not None and not verdict.passed:
                shutil.copytree(folder, out / "cases" / case.name, dirs_exist_ok=True)
            shutil.rmtree(folder, ignore_errors=True)
    _print(stream, [summary_line(rows)])
    if out is not None:
        write_stress_report(out, rows)
        _print(stream, [f"Written: {out / 'stress.html'}"])
    return EXIT_PASSED if all(row.passed for row in rows) else EXIT_FAILED


def list_cases(stream: TextIO) -> int:
    """Print the name of each case and what it stresses."""
    width = max(map(len, CASES))
    _print(stream, [f"{case.name:{width}}  {case.about}" for case in CASES.values()])
    return EXIT_PASSED


def _print(stream: TextIO, lines: Sequence[str]) -> None:
    for line in lines:
        print(line, file=stream, flush=True)


def select(names: Sequence[str]) -> list[Case]:
    """The named cases, all when ``names`` is empty.

    Raises InputError for a name that no case has.
    """
    unknown = [name for name in names if name not in CASES]
    if unknown:
        raise InputError(
            f"There is no stress case '{unknown[0]}'; facestage stress --list shows their names."
        )
    return [CASES[name] for name in dict.fromkeys(names)] or list(CASES.values())


def table_row(verdict: Verdict) -> StressRow:
    """A verdict as a row of the table."""
    outcome = verdict.outcome
    return StressRow(
        name=outcome.name,
        about=verdict.case.about,
        kind=outcome.kind,
        sentence=outcome.sentence,
        faults=verdict.faults,
        mm=outcome.mm,
        start_mm=outcome.start_mm,
        psnr=outcome.psnr,
        condition=outcome.condition,
        iterations=outcome.iterations,
        seconds=outcome.seconds,
        warnings=outcome.warnings,
    )


def run_in_child(case: Case, folder: Path, command: Sequence[str] | None = None) -> Outcome:
    """Run a case in a process of its own; one that outlives ``case.seconds`` is killed and counts
    as hung.

    ``command`` replaces what the child runs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / OUTCOME).unlink(missing_ok=True)
    arguments = command or python_module(
        "facestage.stress.child", case.name, str(folder.absolute())
    )
    began = time.monotonic()
    with (folder / LOG).open("wb") as log:
        try:
            # subprocess.run kills the child when the time is up.
            code = subprocess.run(
                arguments,
                stdout=log,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                timeout=case.seconds,
            ).returncode
        except subprocess.TimeoutExpired:
            return Outcome(
                case.name, HUNG, f"Not done after {case.seconds:g} s.", time.monotonic() - began
            )
    try:
        return Outcome.load(folder / OUTCOME)
    except FacestageError:
        return Outcome(case.name, CRASHED, _death(code, folder / LOG), time.monotonic() - began)


def _death(code: int, log: Path) -> str:
    """How a child ended that wrote no outcome."""
    words = " ".join(log.read_text(encoding="utf-8", errors="replace").split())[-LAST_WORDS:]
    cause = f"exit code {code}"
    if code < 0:
        try:
            cause = signal.Signals(-code).name
        except ValueError:
            cause = f"signal {-code}"
    return f"The process ended with {cause}. {words}".strip()
