"""One whole fit: job in, result folder out, events on the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from facestage.contract.errors import InputError
from facestage.contract.events import Event
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.files.partial import forget_checkpoint
from facestage.contract.job import Job
from facestage.contract.result import Result
from facestage.contract.result_files import RESULT, is_result_file
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.given.truth import read_truth
from facestage.fit.result.output import finish, write_result
from facestage.fit.runs.checkpoint import Checkpoint
from facestage.fit.runs.driver import FitRun
from facestage.fit.runs.place import claimed
from facestage.fit.runs.teller import Teller
from facestage.render.variant import start_renderer

# Writing textures, pictures and the report is part of the budget.
FINISH_SHARE, FINISH_SECONDS_MAX = 0.3, 10.0


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
    out, teller = Path(out).resolve(), Teller(emit)
    teller.reading(job.image.name)
    with claimed(out, RESULT) as partial:
        problem = read_problem(job, teller.tell, landmark_model, fineness=fineness)
        result = _fit(problem, out, partial, resume, teller)
    teller.done(result.advice)
    return result


def _fit(problem: Problem, out: Path, partial: Path, resume: bool, teller: Teller) -> Result:
    """All of the fit that writes, in a place that no other run writes to."""
    job = problem.job
    teller.model(problem.geometry.model)
    teller.previews_into(partial)
    truth = read_truth(job.truth, problem.geometry, job.face_region) if job.truth else None
    start_renderer(job.device)
    forward = ForwardModel(problem.geometry, problem.lights)
    cold_start = teller.seconds
    deadline = time.monotonic() + seconds_to_fit(job.budget_seconds)
    run = FitRun(problem, forward, partial, truth, teller.step)
    with kept_unless_refused(partial, resume):
        fitted = run.run(deadline, Checkpoint.load(partial) if resume else None)
    teller.finishing()
    problem = run.view.problem  # with the lights that joined
    finished = finish(problem, run.view.forward, fitted, truth)
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
