"""``facestage bench``: every contender on every case, judged alike, printed, drawn and written."""

from __future__ import annotations

import os
import platform
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TextIO

from facestage.bench.adam import run_adam
from facestage.bench.cases import Case, find_cases
from facestage.bench.harmonics import run_harmonics
from facestage.bench.parts import part_gains, part_lines
from facestage.bench.relighting import bench_relighting
from facestage.bench.report import PAGE, Bench, text_lines, write_bench
from facestage.bench.settings import (
    ALONE_LINEUP,
    HARMONICS,
    PARTS_LINEUP,
    QUICK_LINEUP,
    WHOLE_LINEUP,
    AdamSettings,
    Contender,
    Lineup,
    SolverSettings,
)
from facestage.bench.solver import run_solver
from facestage.bench.summary import summary_lines, write_qualities
from facestage.bench.table import Final, final, reach_table
from facestage.bench.trace import Judge, Row, Track
from facestage.contract.errors import EXIT_DONE, InputError
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.given.truth import Truth, read_truth
from facestage.render.variant import start_renderer

WARM_UP = 0.25  # of the resolution and of the samples: enough to compile every kernel


def run_bench(
    folders: Sequence[Path],
    model: str | None,
    out: Path,
    quick: bool,
    stream: TextIO,
    *,
    device: str = "auto",
    seed: int = 0,
    alone: bool = False,
    parts: bool = False,
    lineup: Lineup | None = None,
    fineness: Fineness = USUAL,
    face_region: Path | None = None,
) -> int:
    """Measure, print to ``stream`` and write the folder ``out``. Raises InputError before anything
    is measured.

    ``alone``: the fit by itself, nothing to compare it with. ``parts``: beside it the fits without
    each part of the light's model. ``lineup``: who runs, instead of what
    these two say. ``face_region``: which vertices of the cases' scans are the face.
    """
    make_folder(out)
    variant = start_renderer(device)
    if lineup is None:
        lineup = QUICK_LINEUP if quick else ALONE_LINEUP if alone else WHOLE_LINEUP
        lineup = PARTS_LINEUP if parts else lineup
    contenders, qualities, sweep = lineup.main, lineup.qualities, lineup.sweep
    main = tuple(contender.name for contender in contenders)
    rows: list[Row] = []
    finals: list[Final] = []
    with tempfile.TemporaryDirectory(prefix="facestage-bench-") as scratch:
        cases, sentence = find_cases(folders, model, Path(scratch), face_region=face_region)
        _say(stream, sentence)
        for number, case in enumerate(cases[:1] if quick else cases):
            read = time.monotonic()
            problem, truth, judge = open_case(case, device, seed, fineness)
            if number == 0:
                if lineup.warm_up:
                    warm_up(problem, truth, contenders)
                cold = (
                    f"Model, photo and kernels were ready after {time.monotonic() - read:.1f} s, "
                    "not counted below."
                )
            for contender in (*contenders, *qualities, *(sweep if number == 0 else ())):
                if isinstance(contender, AdamSettings) and contender.name in main:
                    # On a slow machine, at least as long as the fit took.
                    contender = replace(contender, budget=max(contender.budget, finals[-1].seconds))
                track = run_contender(problem, truth, contender)
                if number == 0 and contender == contenders[0]:
                    relighting = bench_relighting(out, track)
                new = judge.rows(case.name, contender.family, contender.name, track)
                rows += new
                finals.append(final(new, track.errors))
                last = finals[-1]
                _say(
                    stream,
                    f"{case.name}: {last.contender}: {last.similarity_mm:.2f} mm after "
                    f"{last.seconds:.1f} s",
                )
    machine = f"{platform.machine()}, {os.cpu_count()} CPU cores, Mitsuba variant {variant}."
    bench = Bench(
        rows,
        finals,
        reach_table(rows, main),
        main,
        (*summary_lines(finals), sentence, machine, cold, *relighting),
    )
    write_bench(out, bench)
    write_qualities(out, finals, machine)
    _say(stream, "")
    for line in (*text_lines(bench), *part_lines(part_gains(rows, finals))):
        _say(stream, line)
    _say(stream, f"Written: {out / PAGE}")
    return EXIT_DONE


def open_case(
    case: Case, device: str = "auto", seed: int = 0, fineness: Fineness = USUAL
) -> tuple[Problem, Truth, Judge]:
    """A case read and checked, its truth, and what judges it."""
    job = case.job(device, seed)
    problem = read_problem(job, fineness=fineness)
    assert job.truth is not None
    truth = read_truth(job.truth, problem.geometry, job.face_region)
    return problem, truth, Judge(problem, truth)


def run_contender(problem: Problem, truth: Truth, contender: Contender) -> Track:
    """One contender over one case."""
    if isinstance(contender, AdamSettings):
        return run_adam(problem, truth, contender)
    if contender.family == HARMONICS:
        return run_harmonics(problem, contender)
    return run_solver(problem, truth, contender)


def warm_up(problem: Problem, truth: Truth, contenders: Sequence[Contender]) -> None:
    """Compile each contender's kernels, so that nobody's clock counts it."""
    for contender in contenders:
        if isinstance(contender, AdamSettings):
            run_adam(problem, truth, replace(contender, iterations=1), detail=False)
        elif contender.family != HARMONICS:
            # The harmonics trace no other rays than the fit.
            run_solver(
                problem,
                truth,
                SolverSettings("warm-up", resolution=WARM_UP, samples=WARM_UP),
                detail=False,
            )


def make_folder(out: Path) -> None:
    """The folder to write into. Raises InputError."""
    if out.exists() and not out.is_dir():
        raise InputError(f"The output '{out}' is a file; expected a folder name.")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"Cannot make the folder '{out}' ({error.strerror or error}); choose another."
        ) from error


def _say(stream: TextIO, line: str) -> None:
    print(line, file=stream, flush=True)
