"""One whole fit: job in, result folder out, events on the way."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract.atomic import atomic_folder
from facestage.contract.errors import InputError
from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.contract.job import Job
from facestage.contract.result import Result
from facestage.fit.checkpoint import Checkpoint
from facestage.fit.driver import FitRun
from facestage.fit.fineness import USUAL, Fineness
from facestage.fit.fitted import Progress
from facestage.fit.output import finish, write_result
from facestage.fit.problem import Problem, read_problem
from facestage.fit.shading import ForwardModel
from facestage.fit.truth import Truth
from facestage.render.variant import start_renderer
from facestage.report import write_preview

# Writing textures, pictures and the report is part of the budget.
FINISH_SHARE, FINISH_SECONDS_MAX = 0.3, 10.0
PREVIEW_INTERVAL = 2.0


def partial_folder(out: Path) -> Path:
    """Where a fit into ``out`` keeps its checkpoint and preview until it is done."""
    return out.with_name(f"{out.name}.partial")


def fit_job(
    job: Job, out: Path, resume: bool = False, emit: Callable[[Event], None] = lambda event: None,
    landmark_model: Path | None = None, fineness: Fineness = USUAL,
) -> Result:  # fmt: skip
    """Fit ``job`` and write the result folder ``out``. Raises InputError before anything is written.

    ``landmark_model`` finds the face of a job without landmarks; None looks for it in the usual places.
    """
    out = Path(out).resolve()
    began = time.monotonic()
    emit(Event(STARTED, message=f"Reading {job.image.name}"))

    def emit_timed(event: Event) -> None:
        emit(replace(event, seconds=time.monotonic() - began))

    problem = read_problem(job, emit_timed, landmark_model, fineness=fineness)
    job = problem.job
    model = problem.geometry.model
    emit(Event(PROGRESS, "reading", message=f"Face model: {model.name}; licence: {model.license}; {model.source}"))
    truth = Truth(job.truth, problem.geometry) if job.truth else None
    start_renderer(job.device)
    partial = prepare_partial(out, "result.json")
    forward = ForwardModel(problem.geometry, problem.lights)
    cold_start = time.monotonic() - began
    deadline = time.monotonic() + seconds_to_fit(job.budget_seconds)
    listener = _Listener(problem, forward, partial, emit, began, job.budget_seconds)
    run = FitRun(problem, forward, partial, truth, listener)
    try:
        fitted = run.run(deadline, Checkpoint.load(partial) if resume else None)
    except InputError:
        # Going on would be refused again; a checkpoint that was there before may belong to a job that is fine.
        if not resume:
            shutil.rmtree(partial, ignore_errors=True)
        raise
    emit(
        Event(
            PROGRESS, "pictures", 0, None, time.monotonic() - began, None, 0.92, message="Drawing textures and pictures"
        )
    )
    finished = finish(problem, forward, fitted, truth)
    timings = {"cold_start": cold_start, "optimisation": fitted.seconds, "checks": fitted.check_seconds}
    with atomic_folder(out) as folder:
        result = write_result(folder, problem, fitted, finished, timings)
    result = replace(result, folder=out)
    if fitted.in_time:
        shutil.rmtree(partial, ignore_errors=True)
    emit(Event(DONE, "done", 0, None, time.monotonic() - began, 0.0, 1.0, message=result.advice))
    return result


def prepare_partial(out: Path, marker: str) -> Path:
    """The partial folder of ``out``, made. Raises InputError unless ``out`` is free, or holds an earlier ``marker``."""
    if out.exists() and not out.is_dir():
        raise InputError(f"The output '{out}' is a file; expected a folder name.")
    # The result replaces the folder: never one that holds anything but an earlier result.
    if out.is_dir() and any(out.iterdir()) and not (out / marker).is_file():
        raise InputError(f"The output folder '{out}' holds files that are not a result; choose a new or empty folder.")
    partial = partial_folder(out)
    try:
        partial.mkdir(parents=True, exist_ok=True)
        probe = partial / ".writable"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise InputError(
            f"Cannot write beside '{out}' ({error.strerror or error}); choose a folder that you may write to."
        ) from error
    return partial


def seconds_to_fit(budget: float | None, photos: int = 1) -> float:
    """What of a budget in seconds is left for the fit when the results of ``photos`` have to be written too."""
    if budget is None:
        return float("inf")
    return budget - min(FINISH_SHARE * budget, FINISH_SECONDS_MAX * photos)


class _Listener:
    """Turns progress into events, with a preview picture now and then."""

    def __init__(
        self, problem: Problem, forward: ForwardModel, partial: Path, emit: Callable[[Event], None], began: float,
        budget: float | None,
    ) -> None:  # fmt: skip
        self.problem, self.forward, self.partial = problem, forward, partial
        self.emit, self.began, self.budget = emit, began, budget
        self.preview: str | None = None
        self._last_preview = -np.inf

    def __call__(self, progress: Progress) -> None:
        now = time.monotonic()
        if (
            progress.evaluation is not None
            and progress.photo is not None
            and now - self._last_preview > PREVIEW_INTERVAL
        ):
            self._last_preview = now
            self.preview = str(self.partial / "preview.png")
            photo = progress.photo
            write_preview(Path(self.preview), photo, photo + progress.evaluation.residual)
        left = progress.seconds * (1 - progress.fraction) / max(progress.fraction, 1e-3)
        self.emit(
            Event(
                PROGRESS,
                progress.phase,
                progress.iteration,
                progress.photo_rms,
                now - self.began,
                left,
                0.9 * progress.fraction,
                self.preview,
                f"Fitting: {progress.phase}, step {progress.iteration}",
            )
        )
