"""Several photos of one person: jobs in, one folder out with a result per photo, all of one shape
and skin.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract import person as contract
from facestage.contract.events import Event
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.files.partial import forget_checkpoint
from facestage.contract.job import Job
from facestage.contract.parameters import as_fields
from facestage.contract.person import Person, PersonPhoto
from facestage.contract.result import Result
from facestage.contract.result_files import is_result_file
from facestage.contract.texture_maps import ALBEDO
from facestage.fit.face.unknowns import SHARED, kept
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import read_truth
from facestage.fit.result.output import finish, write_result
from facestage.fit.result.person_advice import company, person_verdict
from facestage.fit.result.person_photos import OwnSizes, check_jobs, face_px, read_photos
from facestage.fit.result.run import kept_unless_refused, seconds_to_fit
from facestage.fit.runs.joint_checkpoint import JointCheckpoint
from facestage.fit.runs.joint_run import JointFitted, JointRun
from facestage.fit.runs.place import claimed
from facestage.fit.runs.teller import Teller
from facestage.fit.textures.merged_maps import MergedMaps
from facestage.fit.textures.refine import Refined, refine, texture_size
from facestage.fit.textures.relief_maps.looks import relief_together
from facestage.fit.trust.fitted import Fitted
from facestage.images.image_io import write_exr
from facestage.render.variant import start_renderer
from facestage.report import write_person_report


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
    out, teller = Path(out).resolve(), Teller(emit, len(jobs))
    check_jobs(jobs)
    teller.reading(f"{len(jobs)} photos of one person")
    with claimed(out, contract.FILE) as partial:
        problems = read_photos(jobs, teller.tell, landmark_model, fineness)
        person = _fit(problems, out, partial, resume, teller)
    teller.done(person.advice)
    return person


def _fit(
    problems: Sequence[Problem], out: Path, partial: Path, resume: bool, teller: Teller
) -> Person:
    """All of the fit that writes, in a place that no other run writes to."""
    jobs = [problem.job for problem in problems]
    teller.previews_into(partial)
    truths = [
        read_truth(job.truth, problems[0].geometry, job.face_region) if job.truth else None
        for job in jobs
    ]
    start_renderer(jobs[0].device)
    forwards = [ForwardModel(problem.geometry, problem.lights) for problem in problems]
    cold_start = teller.seconds
    budgets = [job.budget_seconds for job in jobs if job.budget_seconds is not None]
    budget = max(budgets) if budgets else None
    deadline = time.monotonic() + seconds_to_fit(budget, len(jobs))
    run = JointRun(problems, forwards, partial, truths, teller.step)
    with kept_unless_refused(partial, resume):
        fitted = run.run(deadline, JointCheckpoint.load(partial) if resume else None)
    with atomic_folder(out, is_result_file) as folder:
        person = _write(folder, run, fitted, cold_start, teller)
    if all(one.in_time for one in fitted.photos):
        forget_checkpoint(partial)
    return replace(person, folder=out)


def _write(
    folder: Path, run: JointRun, fitted: JointFitted, cold_start: float, teller: Teller
) -> Person:
    """Every file of the person's folder."""
    started = time.monotonic()
    sizes = OwnSizes()
    shared, hanging = _merged(run, fitted, sizes, teller)
    results = []
    for member, one in zip(run.members, fitted.photos, strict=True):
        teller.drawing(member.number)
        one = replace(one, company=company(member, fitted, run.shape_held))
        problem, one = sizes.of(member, one)
        maps = replace(shared, hanging=hanging.get(member.number))
        finished = finish(problem, member.view.forward, one, member.truth, maps)
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
    write_exr(folder / ALBEDO.file, shared.textures.albedo)
    person = _person(run, fitted, results, timings)
    person.write_into(folder)
    if run.members[0].problem.fineness.report:
        write_person_report(folder, person)
    return person


def _merged(
    run: JointRun, fitted: JointFitted, sizes: OwnSizes, teller: Teller
) -> tuple[Refined, dict[int, np.ndarray | None]]:
    """The maps of the photos that share their skin, and the ``hanging`` hair of each by number."""
    faces = [face_px(member) for member in run.members]
    first = next(member for member in run.members if member.joined)
    size = texture_size(max(faces), first.problem.fineness)
    merged = MergedMaps(first.problem.geometry, size, first.view.forward.log_albedo(first.state))
    relief = relief_together(lambda: _own_sizes(run, fitted, sizes), size)
    hanging: dict[int, np.ndarray | None] = {}
    for member, one in zip(run.members, fitted.photos, strict=True):
        teller.painting(member.number)
        if member.joined:
            problem, one = sizes.of(member, one)
            # A texel counts by the number of pixels that show it.
            weight = (faces[member.number - 1] / max(faces)) ** 2
            maps = refine(problem, member.view.forward, one, size, relief)
            merged.add(maps, one.state, weight)
            hanging[member.number] = maps.hanging
    return merged.maps(), hanging


def _own_sizes(
    run: JointRun, fitted: JointFitted, sizes: OwnSizes
) -> Iterator[tuple[Problem, ForwardModel, Fitted]]:
    """The photos that share their skin, one after another at its own size."""
    for member, one in zip(run.members, fitted.photos, strict=True):
        if member.joined:
            problem, one = sizes.of(member, one)
            yield problem, member.view.forward, one


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
