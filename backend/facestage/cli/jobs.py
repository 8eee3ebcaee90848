"""The jobs that a ``fit`` command line asks for."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from facestage.contract.errors import InputError
from facestage.contract.quality import parse_budget

if TYPE_CHECKING:
    from facestage.contract.job import Job
    from facestage.contract.light_stage import LightStage


def read_job(options: argparse.Namespace) -> Job:
    """The job of a ``fit`` command line that is about one photo."""
    jobs = read_jobs(options)
    if len(jobs) > 1:
        raise InputError(
            f"{len(jobs)} photos were given; add --same-person to fit one shape and skin to all of "
            "them, or fit them one by one."
        )
    return jobs[0]


def read_jobs(options: argparse.Namespace) -> list[Job]:
    """The jobs of a ``fit`` command line, from job folders or from the images and their options."""
    from facestage.contract.job import Job

    count = len(options.job) or len(options.image)
    if options.job:
        own = (
            "image",
            "model",
            "landmarks",
            "camera",
            "focal_px",
            "lights",
            "light_color",
            "surround",
            "environment",
            "white_balance",
            "skin_tone",
            "texture_size",
            "seed",
            "device",
            "face",
        )
        given = [name for name in own if getattr(options, name) not in (None, [])]
        if given or options.freeze:
            raise InputError(
                f"--job already says what to fit; leave out {(given or ['freeze'])[0]}, or "
                "change it in the job."
            )
        jobs = [Job.load(folder) for folder in options.job]
    elif not options.image:
        raise InputError(
            "facestage fit needs a photo or a job: facestage fit IMAGE --out DIR, or --job "
            "DIR --out DIR."
        )
    else:
        landmarks = _for_each(options.landmarks, count, "landmark files")
        cameras = _for_each(options.camera, count, "camera files", one_for_all=True)
        focals = _for_each(options.focal_px, count, "focal lengths", one_for_all=True)
        balances = _for_each(
            options.white_balance and [_white_balance(text) for text in options.white_balance],
            count,
            "white balances",
        )
        jobs = [
            replace(_image_job(options, *own), white_balance=balance)
            for *own, balance in zip(
                options.image, landmarks, cameras, focals, balances, strict=True
            )
        ]
    truths = _for_each(options.truth, count, "truth files")
    regions = _for_each(options.face_region, count, "face regions", one_for_all=True)
    return [_override(*each, options) for each in zip(jobs, truths, regions, strict=True)]


def _for_each(
    values: list[Any] | None, count: int, what: str, one_for_all: bool = False
) -> list[Any]:
    """One value per photo; None for each when none was given."""
    if not values:
        return [None] * count
    if one_for_all and len(values) == 1:
        return values * count
    if len(values) != count:
        raise InputError(
            f"{len(values)} {what} were given for {count} photo{'' if count == 1 else 's'}; "
            "expected one for each, in the order of the photos."
        )
    return values


def _override(
    job: Job, truth: Path | None, region: Path | None, options: argparse.Namespace
) -> Job:
    if options.budget is not None:
        seconds, quality = parse_budget(options.budget)
        job = replace(job, budget_seconds=seconds, quality=quality)
    if truth is not None:
        job = replace(job, truth=truth.absolute())
    if region is not None:
        if job.truth is None:
            raise InputError(
                "--face-region says where a scan's face is, but no scan was given; add --truth "
                "scan.npz."
            )
        job = replace(job, face_region=region.absolute())
    if options.plan is not None:
        job = replace(job, plan=options.plan)
    return job


def _image_job(
    options: argparse.Namespace,
    image: Path,
    landmarks: Path | None,
    camera_file: Path | None,
    focal_px: float | None,
) -> Job:
    from facestage.contract.camera import Camera
    from facestage.contract.job import AUTO, KNOWN, UNKNOWN, Job
    from facestage.contract.landmarks import Landmarks
    from facestage.contract.light_stage import DEFAULT_COUNT, fibonacci_stage
    from facestage.contract.skin_tone import parse_skin_tone
    from facestage.images.image_io import read_photograph

    camera = Camera.read(camera_file) if camera_file else None
    if focal_px is not None:
        camera = Camera.default(*read_photograph(image).size, focal_px)
    count = DEFAULT_COUNT if options.lights is None else options.lights
    known = options.environment is not None
    return Job(
        image=image.absolute(),
        model=options.model or "default",
        landmarks=Landmarks.read(landmarks) if landmarks else None,
        camera=camera,
        stage=_surroundings(options) if known else fibonacci_stage(count),
        exposure=UNKNOWN if known else KNOWN,
        light_color=options.light_color or "multi",
        surround=options.surround or AUTO,
        freeze=tuple(options.freeze),
        seed=options.seed or 0,
        device=options.device or "auto",
        face=options.face,
        skin_tone=None if options.skin_tone is None else parse_skin_tone(options.skin_tone),
        texture_size=options.texture_size,
    )


def _white_balance(text: str) -> tuple[float, ...]:
    """Two numbers, a pixel, or three, a color."""
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"The white balance is '{text}'; expected X,Y, a pixel of something grey in the photo, "
            "or R,G,B, the linear color that it shows."
        ) from None


def _surroundings(options: argparse.Namespace) -> LightStage:
    """The lights that a known map of the surroundings stands for."""
    from facestage.cli.environment import read_environment
    from facestage.contract.environment import ENVIRONMENT_COUNT, environment_stage

    picture, degrees = read_environment(options.environment)
    count = ENVIRONMENT_COUNT if options.lights is None else options.lights
    return environment_stage(picture, degrees, count)
