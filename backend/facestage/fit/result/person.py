"""Several photos of one person: jobs in, one folder out with a result per photo, all of one shape
and skin.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract import person as contract
from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.job import Job
from facestage.contract.parameters import as_fields
from facestage.contract.partial import PREVIEW, forget_checkpoint
from facestage.contract.person import Person, PersonPhoto
from facestage.contract.result import Result
from facestage.contract.result_files import is_result_file
from facestage.fit.face.unknowns import SHARED, kept
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.result.output import finish, write_result
from facestage.fit.result.person_advice import company, person_verdict
from facestage.fit.result.person_photos import at_own_size, check_jobs, face_px, read_photos
from facestage.fit.result.run import PREVIEW_INTERVAL, kept_unless_refused, seconds_to_fit
from facestage.fit.runs.joint_checkpoint import JointCheckpoint
from facestage.fit.runs.joint_progress import JointProgress
from facestage.fit.runs.joint_run import JointFitted, JointRun
from facestage.fit.runs.place import claimed
from facestage.fit.textures.merged_maps import MergedMaps
from facestage.fit.textures.refine import Refined, refine, texture_size
from facestage.images.image_io import write_exr
from facestage.render.variant import start_renderer
from facestage.report import write_person_report, write_preview

FITTED_FRACTION = 0.9  # of the whole work, without textures and pictures


def fit_person(
    jobs: Sequence[Job],
    out: Path,
    resume: bool = False,
    emit: Callable[[Event], None] = lambda event: None,
    landmark_model: Path | None = None,
    fineness: Fineness = USUAL,
) -> Person:
    """Fit ``jobs``, one photo of the same person each, and write the folder ``out``.

    Raises InputError before anything is written.
    """
    out = Path(out).resolve()
    began = time.monotonic()
    check_jobs(jobs)
    emit(Event(STARTED, message=f"Reading {len(jobs)} photos of one person"))

    def emit_timed(event: Event) -> None:
        emit(replace(event, seconds=time.monotonic() - began))

    with claimed(out, contract.FILE) as partial:
        problems = read_photos(jobs, emit_timed, landmark_model, fineness)
        person = _fit(problems, out, partial, resume, emit_timed, began)
    emit_timed(Event(DONE, "done", 0, None, 0.0, 0.0, 1.0, message=person.advice))
    return person


def _fit(
    problems: Sequence[Problem],
    out: Path,
    partial: Path,
    resume: bool,
    emit: Callable[[Event], None],
    began: float,
) -> Person:
    """All of the fit that writes, in a place that no other run writes to."""
    jobs = [problem.job for problem in problems]
    truths = [Truth(job.truth, problems[0].geometry) if job.truth else None for job in jobs]
    start_renderer(jobs[0].device)
    forwards = [ForwardModel(problem.geometry, problem.lights) for problem in problems]
    cold_start = time.monotonic() - began
    budgets = [job.budget_seconds for job in jobs if job.budget_seconds is not None]
    budget = max(budgets) if budgets else None
    deadline = time.monotonic() + seconds_to_fit(budget, len(jobs))
    run = JointRun(problems, forwards, partial, truths, _Listener(len(jobs), partial, emit))
    with kept_unless_refused(partial, resume):
        fitted = run.run(deadline, JointCheckpoint.load(partial) if resume else None)
    with atomic_folder(out, is_result_file) as folder:
        person = _write(folder, run, fitted, cold_start, emit)
    if all(one.in_time for one in fitted.photos):
        forget_checkpoint(partial)
    return replace(person, folder=out)


def _write(
    folder: Path,
    run: JointRun,
    fitted: JointFitted,
    cold_start: float,
    emit: Callable[[Event], None],
) -> Person:
    """Every file of the person's folder."""
    count, started = len(run.members), time.monotonic()
    shared = _merged(run, fitted, emit)
    results = []
    for index, (member, one) in enumerate(zip(run.members, fitted.photos, strict=True)):
        words = f"Drawing the pictures of photo {member.number} of {count}"
        emit(Event(PROGRESS, "pictures", 0, fraction=0.93 + 0.07 * index / count, message=words))
        one = replace(one, company=company(member, fitted, run.shape_held))
        problem, one = at_own_size(member, one)
        finished = finish(problem, member.view.forward, one, member.truth, shared)
        own = folder / f"{member.number}-{member.problem.job.image.stem}"
        own.mkdir()
        timings = {
            "cold_start": cold_start,
            "optimisation": one.seconds,
            "checks": one.check_seconds,
        }
        # Arrays that only the pictures need go with each photo.
        results.append(
            replace(write_result(own, problem, one, finished, timings), folder=Path(own.name))
        )
    timings = {
        "cold_start": cold_start,
        "optimisation": fitted.photos[0].seconds,
        "checks": sum(one.check_seconds for one in fitted.photos),
        "results": time.monotonic() - started,
    }
    write_exr(folder / "albedo.exr", shared.textures.albedo)
    person = _person(run, fitted, results, timings)
    person.write_into(folder)
    write_person_report(folder, person)
    return person


def _merged(run: JointRun, fitted: JointFitted, emit: Callable[[Event], None]) -> Refined:
    """The maps of the photos that share their skin."""
    sizes = [face_px(member) for member in run.members]
    first = next(member for member in run.members if member.joined)
    size = texture_size(max(sizes), first.problem.fineness)
    merged = MergedMaps(first.problem.geometry, size, first.view.forward.log_albedo(first.state))
    for member, one in zip(run.members, fitted.photos, strict=True):
        words = f"Painting the skin that photo {member.number} of {len(run.members)} shows"
        emit(
            Event(
                PROGRESS,
                "texture",
                0,
                fraction=0.9 + 0.03 * member.number / len(run.members),
                message=words,
            )
        )
        if member.joined:
            problem, one = at_own_size(member, one)
            # A texel counts by the number of pixels that show it.
            weight = (sizes[member.number - 1] / max(sizes)) ** 2
            merged.add(refine(problem, member.view.forward, one, size), one.state, weight)
    return merged.maps()


def _person(
    run: JointRun, fitted: JointFitted, results: Sequence[Result], timings: dict[str, float]
) -> Person:
    photos = tuple(
        PersonPhoto(
            member.number,
            str(member.problem.job.image),
            str(result.folder),
            result.status,
            result.advice,
            member.joined and not run.shape_held,
            dict(result.errors),
        )
        for member, result in zip(run.members, results, strict=True)
    )
    state = next(member.state for member in run.members if member.joined)
    status, advice = person_verdict(photos, fitted)
    shared = {name: value for name, value in kept(state).items() if name in SHARED}
    return Person(
        status=status,
        advice=advice,
        model=run.members[0].problem.job.model,
        photos=photos,
        timings=timings,
        **as_fields(Person, shared),
    )


class _Listener:
    """Turns progress into events that say which photo, with a preview picture now and then."""

    def __init__(self, photos: int, partial: Path, emit: Callable[[Event], None]) -> None:
        self.photos, self.file, self.emit = photos, partial / PREVIEW, emit
        self.preview: str | None = None
        self._last_preview = -np.inf

    def __call__(self, joint: JointProgress) -> None:
        progress, now = joint.progress, time.monotonic()
        due = now - self._last_preview > PREVIEW_INTERVAL
        if due and progress.evaluation is not None and progress.photo is not None:
            self._last_preview = now
            self.preview = str(self.file)
            write_preview(self.file, progress.photo, progress.photo + progress.evaluation.residual)
        step = f"{progress.phase}, step {progress.iteration}"
        if joint.together:
            words = f"Fitting {self.photos} photos together: {step} (photo {joint.photo} is shown)"
        else:
            words = f"Fitting photo {joint.photo} of {self.photos}: {step}"
        left = progress.seconds * (1 - progress.fraction) / max(progress.fraction, 1e-3)
        self.emit(
            Event(
                PROGRESS,
                progress.phase,
                progress.iteration,
                progress.photo_rms,
                0.0,
                left,
                FITTED_FRACTION * progress.fraction,
                self.preview,
                words,
            )
        )
