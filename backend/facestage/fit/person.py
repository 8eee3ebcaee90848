"""Several photos of one person: jobs in, one folder out with a result per photo, all of one shape and skin."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract import person as contract
from facestage.contract.errors import InputError
from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.contract.job import Job
from facestage.contract.person import PHOTOS_MAX, Person, PersonPhoto
from facestage.contract.result import BUDGET_SPENT, CONVERGED, STOPPED, Result
from facestage.contract.storage import atomic_folder
from facestage.fit.joint_checkpoint import JointCheckpoint
from facestage.fit.joint_run import JointFitted, JointProgress, JointRun
from facestage.fit.member import Member
from facestage.fit.merged_maps import MergedMaps
from facestage.fit.output import finish, write_result
from facestage.fit.problem import Problem, read_problem
from facestage.fit.refine import SPECULAR_TEXTURE, Refined, refine, texture_size
from facestage.fit.run import PREVIEW_INTERVAL, prepare_partial, seconds_to_fit
from facestage.fit.same_person import Difference
from facestage.fit.shading import ForwardModel
from facestage.fit.truth import Truth
from facestage.image_io import write_exr
from facestage.render.variant import start_renderer
from facestage.report import write_person_report, write_preview

# What the jobs of one person must agree on, in words.
COMMON = {
    "model": "the face model", "freeze": "what is frozen", "weights": "the weights", "quality": "the quality",
    "plan": "the plan", "seed": "the seed", "device": "the device",
}  # fmt: skip
FITTED_FRACTION = 0.9  # of the whole work, without textures and pictures


def fit_person(
    jobs: Sequence[Job], out: Path, resume: bool = False, emit: Callable[[Event], None] = lambda event: None,
    landmark_model: Path | None = None,
) -> Person:  # fmt: skip
    """Fit ``jobs``, one photo of the same person each, and write the folder ``out``.

    Raises InputError before anything is written.
    """
    out = Path(out).resolve()
    began = time.monotonic()
    _check(jobs)
    emit(Event(STARTED, message=f"Reading {len(jobs)} photos of one person"))
    problems = _read(jobs, emit, landmark_model)
    truths = [Truth(job.truth, problems[0].geometry) if job.truth else None for job in jobs]
    start_renderer(jobs[0].device)
    partial = prepare_partial(out, contract.FILE)
    forwards = [ForwardModel(problem.geometry, problem.lights) for problem in problems]
    cold_start = time.monotonic() - began
    budgets = [job.budget_seconds for job in jobs if job.budget_seconds is not None]
    budget = max(budgets) if budgets else None
    deadline = time.monotonic() + seconds_to_fit(budget, len(jobs))
    run = JointRun(problems, forwards, partial, truths, _Listener(len(jobs), partial, emit, began))
    try:
        fitted = run.run(deadline, JointCheckpoint.load(partial) if resume else None)
    except InputError:
        # Going on would be refused again; a checkpoint that was there before may belong to jobs that are fine.
        if not resume:
            shutil.rmtree(partial, ignore_errors=True)
        raise
    with atomic_folder(out) as folder:
        person = _write(
            folder, run, fitted, cold_start, lambda event: emit(replace(event, seconds=time.monotonic() - began))
        )
    if all(one.in_time for one in fitted.photos):
        shutil.rmtree(partial, ignore_errors=True)
    emit(Event(DONE, "done", 0, None, time.monotonic() - began, 0.0, 1.0, message=person.advice))
    return replace(person, folder=out)


def _check(jobs: Sequence[Job]) -> None:
    """Raise InputError unless the jobs can be of one person."""
    if not 2 <= len(jobs) <= PHOTOS_MAX:
        raise InputError(
            f"{len(jobs)} photo{'' if len(jobs) == 1 else 's'} of one person given; expected 2 to {PHOTOS_MAX}. "
            "Leave out --same-person for one photo; of many, choose those that differ most in pose and light."
        )
    for name, words in COMMON.items():
        for number, job in enumerate(jobs[1:], 2):
            if getattr(job, name) != getattr(jobs[0], name):
                raise InputError(
                    f"The jobs of photos 1 and {number} differ in {words} ('{getattr(jobs[0], name)}' and "
                    f"'{getattr(job, name)}'), which photos of one person share; make them equal."
                )
    seen: dict[Path, int] = {}
    for number, job in enumerate(jobs, 1):
        earlier = seen.setdefault(job.image.resolve(), number)
        if earlier != number:
            raise InputError(f"Photos {earlier} and {number} are the same file '{job.image}'; give each photo once.")


def _read(jobs: Sequence[Job], emit: Callable[[Event], None], landmark_model: Path | None) -> list[Problem]:
    """The problems of all photos, over one face geometry."""
    problems: list[Problem] = []
    for number, job in enumerate(jobs, 1):
        try:
            problems.append(read_problem(job, emit, landmark_model, problems[0].geometry if problems else None))
        except InputError as error:
            raise InputError(f"Photo {number} of {len(jobs)} ('{job.image.name}'): {error}") from error
    return problems


def _write(
    folder: Path, run: JointRun, fitted: JointFitted, cold_start: float, emit: Callable[[Event], None]
) -> Person:  # fmt: skip
    """Every file of the person's folder."""
    count, started = len(run.members), time.monotonic()
    shared = _merged(run, fitted, emit)
    results = []
    for index, (member, one) in enumerate(zip(run.members, fitted.photos, strict=True)):
        words = f"Drawing the pictures of photo {member.number} of {count}"
        emit(Event(PROGRESS, "pictures", 0, fraction=0.93 + 0.07 * index / count, message=words))
        one = replace(one, company=_company(member, fitted, run.shape_held))
        finished = finish(member.problem, member.view.forward, one, member.truth, shared)
        own = folder / f"{member.number}-{member.problem.job.image.stem}"
        own.mkdir()
        timings = {"cold_start": cold_start, "optimisation": one.seconds, "checks": one.check_seconds}
        # Arrays that only the pictures need go with each photo.
        results.append(replace(write_result(own, member.problem, one, finished, timings), folder=Path(own.name)))
    timings = {
        "cold_start": cold_start, "optimisation": fitted.photos[0].seconds,
        "checks": sum(one.check_seconds for one in fitted.photos), "results": time.monotonic() - started,
    }  # fmt: skip
    write_exr(folder / "albedo.exr", shared.textures.albedo)
    person = _person(run, fitted, results, timings)
    person.write_into(folder)
    write_person_report(folder, person)
    return person


def _merged(run: JointRun, fitted: JointFitted, emit: Callable[[Event], None]) -> Refined:
    """The maps of the photos that share their skin."""
    problems = [member.problem for member in run.members]
    size = texture_size(max(problem.face_size_px for problem in problems))
    merged = MergedMaps(problems[0].geometry, size, SPECULAR_TEXTURE)
    for member, one in zip(run.members, fitted.photos, strict=True):
        words = f"Painting the skin that photo {member.number} of {len(problems)} shows"
        emit(Event(PROGRESS, "texture", 0, fraction=0.9 + 0.03 * member.number / len(problems), message=words))
        if member.joined:
            maps = refine(member.problem, member.view.forward, one, size)
            merged.add(maps, one.state, member.problem.face_size_px)
    return merged.maps()


def _company(member: Member, fitted: JointFitted, shape_held: bool) -> str:
    """What speaks against a photo beside the others."""
    difference = fitted.odd.get(member.number - 1)
    if difference is not None:
        return (
            f"This photo may show another person than the others: {_distance(difference)}."
            f"{' It is left out of the shape that they share.' if member.stranger else ''} Check who is on it and its "
            "landmarks."
        )
    if member.doubt and not shape_held:
        return (
            f"This photo is left out of the shape that the others share, because {member.doubt}; check its landmarks, "
            "and mask what is not the face with an alpha channel."
        )
    return ""


def _distance(difference: Difference) -> str:
    return (
        f"its landmarks lie further from what those of the others predict than chance explains (a squared distance of "
        f"{difference.statistic:.0f}, at most {difference.limit:.0f} is plausible)"
    )


def _person(run: JointRun, fitted: JointFitted, results: Sequence[Result], timings: dict[str, float]) -> Person:
    photos = tuple(
        PersonPhoto(
            member.number, str(member.problem.job.image), str(result.folder), result.status, result.advice,
            member.joined and not run.shape_held, dict(result.errors),
        )
        for member, result in zip(run.members, results, strict=True)
    )  # fmt: skip
    state = next(member.state for member in run.members if member.joined)
    status, advice = _verdict(photos, fitted)
    return Person(
        status, advice, run.members[0].problem.job.model, photos, state.identity, state.albedo, state.specular,
        state.roughness, timings,
    )  # fmt: skip


def _verdict(photos: Sequence[PersonPhoto], fitted: JointFitted) -> tuple[str, str]:
    """Status and advice for all photos together."""
    statuses = {photo.status for photo in photos}
    if BUDGET_SPENT in statuses:
        return BUDGET_SPENT, next(photo.advice for photo in photos if photo.status == BUDGET_SPENT)
    odd = sorted(fitted.odd)
    if len(photos) == len(odd) == 2:
        return STOPPED, (
            f"Photos 1 and 2 may show different people: {_distance(fitted.odd[0])}. Check who is on them and their "
            "landmarks, or fit them one by one."
        )
    if odd:
        which = photos[odd[0]]
        return STOPPED, f"Photo {which.number} ({Path(which.image).name}): {which.advice}"
    against = next((photo for photo in photos if photo.status == STOPPED), None)
    if against is not None:
        return STOPPED, f"Photo {against.number} ({Path(against.image).name}): {against.advice}"
    psnr = [photo.errors["psnr_skin"] for photo in photos if "psnr_skin" in photo.errors]
    return CONVERGED, (
        f"Converged: {len(photos)} photos share one shape and one skin, which explain them with a PSNR of "
        f"{min(psnr):.1f} to {max(psnr):.1f} dB."
    )


class _Listener:
    """Turns progress into events that say which photo, with a preview picture now and then."""

    def __init__(self, photos: int, partial: Path, emit: Callable[[Event], None], began: float) -> None:
        self.photos, self.partial, self.emit, self.began = photos, partial, emit, began
        self.preview: str | None = None
        self._last_preview = -np.inf

    def __call__(self, joint: JointProgress) -> None:
        progress, now = joint.progress, time.monotonic()
        due = now - self._last_preview > PREVIEW_INTERVAL
        if due and progress.evaluation is not None and progress.photo is not None:
            self._last_preview = now
            self.preview = str(self.partial / "preview.png")
            write_preview(Path(self.preview), progress.photo, progress.photo + progress.evaluation.residual)
        step = f"{progress.phase}, step {progress.iteration}"
        if joint.together:
            words = f"Fitting {self.photos} photos together: {step} (photo {joint.photo} is shown)"
        else:
            words = f"Fitting photo {joint.photo} of {self.photos}: {step}"
        left = progress.seconds * (1 - progress.fraction) / max(progress.fraction, 1e-3)
        self.emit(
            Event(
                PROGRESS, progress.phase, progress.iteration, progress.photo_rms, now - self.began, left,
                FITTED_FRACTION * progress.fraction, self.preview, words,
            )
        )  # fmt: skip
