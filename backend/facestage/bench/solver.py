"""The fit as a contender: the schedule as it is, or scaled, under a budget."""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.bench.settings import SURROUND, SolverSettings
from facestage.bench.trace import Snapshot, Track
from facestage.contract.job import WITHOUT, Job
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.result.output import finish
from facestage.fit.runs.driver import FitRun
from facestage.fit.runs.progress import Progress
from facestage.fit.stages.phases import default_schedule
from facestage.fit.trust.fitted import Fitted

# What is measured of the finished result rather than of every step.
JUDGED = (
    "albedo",
    "light",
    "landmark_stage_covered_mm",
    "covered_mm",
    "within_1_sigma",
    "within_2_sigma",
    "skin_tone",
    "true_ita",
    "chromaticity",
)


def run_solver(
    problem: Problem, truth: Truth, settings: SolverSettings, detail: bool = True
) -> Track:
    """Fit ``problem``; with ``detail`` up to the finished picture, as ``facestage fit`` does."""
    snapshots: list[Snapshot] = []

    def listen(progress: Progress) -> None:
        lit = progress.evaluation is not None
        snapshots.append(Snapshot(progress.seconds, progress.phase, progress.state, lit))

    problem = replace(problem, job=without_part(problem.job, settings.without))
    forward = ForwardModel(problem.geometry, problem.lights)
    schedule = default_schedule(
        replace(problem.job, quality=settings.quality), problem.fineness.steps_max
    )
    schedule = schedule.scaled(settings.resolution, settings.samples)
    if settings.shadow_edges is not None:
        schedule = schedule.with_shadow_edges(settings.shadow_edges)
    with tempfile.TemporaryDirectory(prefix="facestage-bench-") as folder:
        run = FitRun(problem, forward, Path(folder), None, listen, schedule)
        budget = float("inf") if settings.budget is None else settings.budget
        fitted = run.run(time.monotonic() + budget)
    # Lights behind the face may have joined.
    track = Track(snapshots, run.view.forward, fitted.stage, run.view.placed_stage)
    return finished_track(track, run.view.problem, truth, fitted) if detail else track


def without_part(job: Job, part: str) -> Job:
    """The job without a part of the light's model, of PARTS; as it is where that is empty."""
    if not part:
        return job
    if part == SURROUND:
        return replace(job, surround=WITHOUT)
    # From a start at nothing it cannot leave.
    return replace(
        job, freeze=(*job.freeze, part), initial=dict(job.initial) | {part: np.array(0.0)}
    )


def finished_track(track: Track, problem: Problem, truth: Truth, fitted: Fitted) -> Track:
    """The track with its textures and final picture; rendering the picture is off the clock."""
    finished = finish(problem, track.forward, replace(fitted, trace=[]), truth)
    errors = {name: finished.errors[name] for name in JUDGED if name in finished.errors}
    seconds = fitted.seconds + finished.timings.get("albedo_detail", 0.0)
    return replace(track, errors=errors, picture=finished.picture.color, picture_seconds=seconds)


def landmark_start(run: FitRun, snapshots: list[Snapshot]) -> Fitted:
    """The landmark phases alone, where every contender starts.

    ``run`` has no photo phase in its schedule.
    """
    run.listen = lambda progress: snapshots.append(
        Snapshot(progress.seconds, progress.phase, progress.state, lit=False)
    )
    return run.run(float("inf"))
