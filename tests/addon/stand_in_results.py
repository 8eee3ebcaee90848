"""What the stand-in for the backend makes up: results, landmarks and relight caches."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

os.environ["OPENCV_IO_ENABLE_OPENEXR"] = "1"

import cv2
import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.corrections import joined, read_corrections
from facestage.contract.face_model import FaceModel
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.files.storage import write_json
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from facestage.contract.person import Person, PersonPhoto
from facestage.contract.relight_cache import RelightCache, relight_fingerprint
from facestage.contract.result import CONVERGED, STOPPED, Result
from facestage.contract.sequence import Sequence


def fit(job_folder: Path, out: Path) -> None:
    with atomic_folder(out) as folder:
        write_result(Job.load(job_folder), folder)


def fit_person(job_folders: list[Path], out: Path) -> None:
    """The last photo is another person's."""
    jobs, photos = [Job.load(folder) for folder in job_folders], []
    with atomic_folder(out) as folder:
        for number, job in enumerate(jobs, 1):
            name = f"{number}-{job.image.stem}"
            (folder / name).mkdir()
            result = write_result(job, folder / name, number)
            status, advice = result.status, result.advice
            if number == len(jobs):
                status, advice = STOPPED, "The photo may show another person."
            photos.append(
                PersonPhoto(number, str(job.image), name, status, advice, number < len(jobs), {})
            )
        Person(
            CONVERGED,
            "The stand-in knows them.",
            jobs[0].model,
            tuple(photos),
            result.identity,
            result.albedo,
            result.specular,
            result.roughness,
            {},
        ).write_into(folder)


def track_again(film: Path, out: Path, corrected: Path, options: dict[str, str]) -> None:
    """The frames right beside a corrected one follow by half."""
    track, given = Sequence.load(out), read_corrections(corrected)
    expression, numbers = track.expression.copy(), [frame.number for frame in track.frames]
    for each in given:
        place = numbers.index(each.frame)
        for name, value in each.weights.items():
            column = expression[:, track.expression_names.index(name)]
            column[[place - 1, place + 1]] += 0.5 * (value - column[place])
            column[place] = value
    found = joined(track.corrected, given)
    replace(track, expression=expression, corrected=found).write_into(out)
    write_json(out / "asked.json", {"film": str(film), "frames": options.get("--frames")})


def write_result(job: Job, folder: Path, seed: int = 2) -> Result:
    model = FaceModel.load(Path(os.environ["STAND_IN_MODEL"]))
    result = made_up(job, model, seed)
    result.write_into(folder)
    rng = np.random.default_rng(3)
    for name, channels in (
        ("albedo", 3),
        ("specular", 1),
        ("roughness", 1),
        ("render", 3),
        ("light_probe", 3),
    ):
        pixels = rng.uniform(0.1, 0.6, (16, 16, channels)).astype(np.float32)
        assert cv2.imwrite(str(folder / f"{name}.exr"), pixels)
    if job.landmarks is None:
        detect(job.image, folder / "landmarks.json", job.face or 1)
    else:
        write_json(folder / "landmarks.json", job.landmarks.to_json())
    (folder / "report.html").write_text("<p>report</p>", encoding="utf-8")
    return result


def detect(image: Path, out: Path, face: int) -> None:
    """478 points in a disc in the middle of the photo, turned by the number of the face; the last
    ten are hidden.
    """
    height, width = cv2.imread(str(image)).shape[:2]
    turn = face + np.arange(478) * 2.399963
    radius = 0.3 * min(width, height) * np.sqrt((np.arange(478) + 0.5) / 478)
    points = np.array([width / 2, height / 2]) + radius[:, None] * np.stack(
        [np.cos(turn), np.sin(turn)], 1
    )
    write_json(out, Landmarks("mediapipe478", points, np.arange(478) < 468).to_json())


def relight_cache(folder: Path) -> None:
    """Random images on a rectangle of the picture."""
    result, rng = Result.load(folder), np.random.default_rng(4)
    width, height = result.camera.width, result.camera.height
    pixels = (np.arange(10, 50)[:, None] * width + np.arange(20, 70)).ravel()
    images = rng.uniform(0, 0.01, (3, len(result.stage), len(pixels)))
    RelightCache.of_images(
        width,
        height,
        pixels,
        rng.uniform(0.2, 1, len(pixels)),
        images,
        4,
        relight_fingerprint(result),
    ).save(folder)


def made_up(job: Job, model: FaceModel, seed: int) -> Result:
    """A result with every value off its default, so that a forgotten one shows."""
    rng = np.random.default_rng(seed)
    height, width = cv2.imread(str(job.image)).shape[:2]
    camera = job.camera or Camera(width, height, 1.7 * width, (0.52 * width, 0.46 * height))
    turn = np.linalg.qr(np.eye(3) + 0.1 * rng.normal(size=(3, 3)))[0]
    turn *= np.sign(np.diag(turn))
    model_to_camera = np.eye(4)
    model_to_camera[:3, :3], model_to_camera[:3, 3] = turn, (0.02, -0.01, -1.1)
    camera_to_stage = np.eye(4)
    camera_to_stage[:3, 3] = (-0.02, 0.01, 1.1)
    if job.camera_to_stage is not None:
        camera_to_stage = job.camera_to_stage
    identity = rng.normal(size=len(model.identity_names))
    expression = rng.uniform(0, 1, len(model.expression_names))
    stage = job.stage or fibonacci_stage()
    vertices = model.shape(identity, expression) @ turn.T + model_to_camera[:3, 3]
    return Result(
        status=os.environ.get("STAND_IN_STATUS", CONVERGED),
        advice="The stand-in is content.",
        model=job.model,
        camera=camera,
        camera_to_stage=camera_to_stage,
        model_to_camera=model_to_camera,
        identity=identity,
        expression=expression,
        albedo=rng.normal(size=len(model.albedo_basis)),
        specular=np.full((8, 8), 0.7),
        roughness=0.37,
        stage=stage.with_radiance(rng.uniform(0, 9, (len(stage), 3))),
        vertices=vertices.astype(np.float32),
        triangles=model.triangles,
        identity_names=model.identity_names,
        expression_names=model.expression_names,
    )
