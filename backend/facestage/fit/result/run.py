"""One whole fit: job in, result folder out, events on the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.job import Job
from facestage.contract.partial import PREVIEW, forget_checkpoint
from facestage.contract.result import Result
from facestage.contract.result_files import RESULT, is_result_file
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.given.truth import Truth
from facestage.fit.result.output import finish, write_result
from facestage.fit.runs.checkpoint import Checkpoint
from facestage.fit.runs.driver import FitRun
from facestage.fit.runs.place import claimed
from facestage.fit.trust.fitted import Progress
from facestage.render.variant import start_renderer
from facestage.report import write_preview

# Writing textures, pictures and the report is part of the budget.
FINISH_SHARE, FINISH_SECONDS_MAX = 0.3, 10.0
PREVIEW_INTERVAL = 2.0


def fit_job(
    job: Job,
    out: Path,
    resume: bool = False,
    emit: Callable[[Event], None] = lambda event: None,
    landmark_model: Path | None = None,
    fineness: Fineness = USUAL,
) -> Result:
    """Fit ``job`` and write the result folder ``out``. Raises InputError before anything is
    written.

    ``landmark_model`` finds the face of a job without landmarks; None looks for it in the usual
    places.
    """
    out = Path(out).resolve()
    began = time.monotonic()
    emit(Event(STARTED, message=f"Reading {job.image.name}"))

    def emit_timed(event: Event) -> None:
        emit(replace(event, seconds=time.monotonic() - began))

    with claimed(out, RESULT) as partial:
        problem = read_problem(job, emit_timed, landmark_model, fineness=fineness)
        result = _fit(problem, out, partial, resume, emit_timed, began)
    emit_timed(Event(DONE, "done", 0, None, 0.0, 0.0, 1.0, message=result.advice))
    return result


def _fit(
    problem: Problem,
    out: Path,
    partial: Path,
    resume: bool,
    emit: Callable[[Event], None],
    began: float,
) -> Result:
    """All of the fit that writes, in a place that no other run writes to."""
    job = problem.job
    model = problem.geometry.model
    emit(
        Event(
            PROGRESS,
            "reading",
            message=f"Face model: {model.name}; licence: {model.license}; {model.source}",
        )
    )
    truth = Truth(job.truth, problem.geometry) if job.truth else None
    start_renderer(job.device)
    forward = ForwardModel(problem.geometry, problem.lights)
    cold_start = time.monotonic() - began
    deadline = time.monotonic() + seconds_to_fit(job.budget_seconds)
    run = FitRun(problem, forward, partial, truth, _Listener(partial, emit))
    with kept_unless_refused(partial, resume):
        fitted = run.run(deadline, Checkpoint.load(partial) if resume else None)
    emit(
        Event(
            PROGRESS, "pictures", 0, None, 0.0, None, 0.92, message="Drawing textures and pictures"
        )
    )
    finished = finish(problem, forward, fitted, truth)
    timings = {
        "cold_start": cold_start,
        "optimisation": fitted.seconds,
        "checks": fitted.check_seconds,
    }
    with atomic_folder(out, is_result_file) as folder:
        result = write_result(folder, problem, fitted, finished, timings)
    if fitted.in_time:
        forget_checkpoint(partial)
    return replace(result, folder=out)


@contextmanager
def kept_unless_refused(partial: Path, resume: bool) -> Iterator[None]:
    """Around a run, which begins without the checkpoint of an earlier one unless it is to
    ``resume`` from it.
    """
    if not resume:
        forget_checkpoint(partial)
    try:
        yield
    except InputError:
        # Going on would be refused again; a checkpoint that was there before may belong to a job
        # that is fine.
        if not resume:
            forget_checkpoint(partial)
        raise


def seconds_to_fit(budget: float | None, photos: int = 1) -> float:
    """What of a budget in seconds is left for the fit when the results of ``photos`` have to be
    written too.
    """
    if budget is None:
        return float("inf")
    return budget - min(FINISH_SHARE * budget, FINISH_SECONDS_MAX * photos)


class _Listener:
    """Turns progress into events, with a preview picture now and then."""

    def __init__(self, partial: Path, emit: Callable[[Event], None]) -> None:
        self.file, self.emit = partial / PREVIEW, emit
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
            self.preview = str(self.file)
            photo = progress.photo
            write_preview(self.file, photo, photo + progress.evaluation.residual)
        left = progress.seconds * (1 - progress.fraction) / max(progress.fraction, 1e-3)
        words = f"Fitting: {progress.phase}, step {progress.iteration}"
        self.emit(
            Event(
                PROGRESS,
                progress.phase,
                progress.iteration,
                progress.photo_rms,
                0.0,
                left,
                0.9 * progress.fraction,
                self.preview,
                words,
            )
        )
