"""What is done with each input: one function per reader, which reads, looks at what came out, and
uses it a little.
"""

from __future__ import annotations

import json
import os
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from fuzz.consistent import check, check_array, check_dataclass, require


def install_small_default_model() -> None:
    """Let ``default`` be a face of 529 vertices, so that what is carried over from it costs
    milliseconds.
    """
    from facestage.models import registry
    from fuzz.seeds.contract import small_default

    real = registry.load_model

    def load_model(specification: str) -> Any:
        return small_default() if specification == "default" else real(specification)

    registry.load_model = load_model


def read_job(folder: Path) -> None:
    from facestage.contract.job import Job

    job = Job.load(folder)
    points = None if job.landmarks is None else job.landmarks
    check_dataclass(job, but=("landmarks",))
    if points is not None:
        check_landmarks(points)


def check_landmarks(landmarks: Any) -> None:
    check_dataclass(landmarks, but=("points",))
    check_array(landmarks.points[landmarks.counted], "Landmarks.points")
    require(landmarks.visible.dtype == bool, "Landmarks.visible is not bool")


def read_result(folder: Path) -> None:
    check_result(load_result(folder))


def load_result(folder: Path) -> Any:
    from facestage.contract.result import Result

    return Result.load(folder)


def check_result(result: Any) -> None:
    # The further arrays are only shown: a deviation of what nothing observed is infinite.
    check_dataclass(replace(result, arrays={}))
    for name, array in result.arrays.items():
        check_array(np.asarray(np.nan_to_num(array)), f"Result.arrays[{name!r}]")
    count = len(result.vertices)
    require(result.vertices.shape == (count, 3), "Result.vertices is not (n, 3)")
    require(
        result.triangles.ndim == 2 and result.triangles.shape[1] == 3,
        "Result.triangles is not (t, 3)",
    )
    inside = not result.triangles.size or (
        result.triangles.min() >= 0 and result.triangles.max() < count
    )
    require(inside, "Result.triangles refers to vertices that are not there")
    require(
        result.identity.shape == (len(result.identity_names),),
        "Result.identity and its names differ",
    )
    require(
        result.expression.shape == (len(result.expression_names),),
        "Result.expression and its names differ",
    )
    for name in ("camera_to_stage", "model_to_camera", "model_to_stage"):
        require(getattr(result, name).shape == (4, 4), f"Result.{name} is not (4, 4)")
    require(
        result.specular.ndim == 2 and result.albedo.ndim == 1,
        "Result's coefficients have other dimensions",
    )
    require(np.isfinite(result.model_to_stage).all(), "Result.model_to_stage is not finite")


def read_person(folder: Path) -> None:
    from facestage.contract.person import Person

    person = Person.load(folder)
    check_dataclass(person)
    require(
        person.identity.ndim == person.albedo.ndim == 1 and person.specular.ndim == 2,
        "Person has other shapes",
    )


def read_sequence(folder: Path) -> None:
    from facestage.contract.sequence import Sequence

    found = Sequence.load(folder)
    check_dataclass(found, but=("deviations",))
    count = len(found.frames)
    require(found.expression.shape == (count, len(found.expression_names)), "other expressions")
    require(found.model_to_camera.shape == (count, 4, 4), "other poses")


def read_corrections(folder: Path) -> None:
    from facestage.contract.corrections import read_corrections

    found = read_corrections(folder / "corrections.json")
    require(len({each.frame for each in found}) == len(found) > 0, "a frame twice, or none")
    for each in found:
        check_dataclass(each)


def read_sequence_truth(folder: Path) -> None:
    from facestage.fit.sequence.sequence_truth import SequenceTruth
    from fuzz.seeds.contract import tiny_model

    model = tiny_model()
    found = SequenceTruth(folder / "truth.npz", model, 2)
    check_array(found.vertices, "vertices")
    require(found.vertices.shape == (2, len(found.region), 3), "other vertices")


def read_landmarks(folder: Path) -> None:
    from facestage.contract.landmarks import Landmarks

    found = Landmarks.read(folder / "landmarks.json")
    check_landmarks(found)
    found.check_inside(24, 20)


def read_camera(folder: Path) -> None:
    from facestage.contract.camera import Camera

    found = Camera.read(folder / "camera.json")
    check_dataclass(found)
    check_dataclass(found.scaled(0.5))


def read_live_link(folder: Path) -> None:
    from facestage.contract.live_link import read_recording

    found = read_recording(folder / "take.csv")
    check_array(found.seconds, "seconds")
    require(bool((np.diff(found.seconds) > 0).all()), "the seconds do not grow")
    for name, values in found.weights.items():
        check_array(values, name)
        require(len(values) == len(found.seconds), f"{name} has another length")


def read_manifest(folder: Path) -> None:
    from facestage.batch.manifest import read_manifest

    rows = read_manifest(folder / "photos.csv", ("camera", "focal_px"))
    for row in rows:
        check_dataclass(row)
        plain = row.name not in (".", "..") and Path(row.name).name == row.name
        require(plain, f"{row.name!r} is no name of a folder")
        require(all(row.photos), "a photo without a name")
    require(len({row.name.casefold() for row in rows}) == len(rows), "two rows of one name")


def read_journal(folder: Path) -> None:
    from facestage.contract.batch import read_journal

    for name, row in read_journal(folder).items():
        check_dataclass(row)
        require(row.name == name and bool(row.photos), "another row")
        row.to_line()


def read_reflectance(folder: Path) -> None:
    from facestage.contract.reflectance import ReflectanceField

    field = ReflectanceField.load(folder)
    check_dataclass(field)
    count = len(field.images)
    require(field.directions.shape == (count, 3), "other directions")
    require(field.solid_angles.shape == (count,), "other solid angles")


def read_event(folder: Path) -> None:
    from facestage.contract.events import Event

    line = (folder / "line.json").read_bytes().decode("utf-8", "replace")
    event = Event.from_line(line)
    if event is not None:
        check_dataclass(event)
        event.to_line()


@cache
def _truth_scene() -> tuple[Any, Any]:
    from facestage.contract.camera import Camera
    from facestage.fit.face.geometry import FaceGeometry
    from facestage.fit.face.state import State
    from fuzz.seeds.contract import tiny_model

    model = tiny_model()
    state = State(
        np.eye(3),
        np.array([0, 0, -0.6]),
        Camera.default(24, 20),
        np.zeros(len(model.identity_names)),
        np.zeros(len(model.expression_names)),
        np.zeros(0),
        np.zeros((0, 2)),
        np.zeros(len(model.albedo_basis)),
        0.4,
        np.full((2, 2), 0.5),
    )
    return FaceGeometry(model), state


def read_truth(folder: Path) -> None:
    from facestage.contract.light_stage import fibonacci_stage
    from facestage.fit.given.truth import read_truth

    geometry, state = _truth_scene()
    truth = read_truth(folder / "truth.npz", geometry)
    check(truth.geometry_errors(state), dict[str, float], "geometry errors")
    check(truth.light_error(fibonacci_stage(2), np.zeros(3)), float | None, "light error")
    check(truth.albedo_error(np.full((4, 4, 3), 0.4)), float | None, "albedo error")


def read_scan(folder: Path) -> None:
    from facestage.contract.scan import Scan

    region = folder / "region.npy"
    check_dataclass(Scan.load(folder / "scan.npz", region if region.exists() else None))


def read_relight(folder: Path) -> None:
    from facestage.contract.relight_cache import RelightCache

    result = load_result(folder)
    cache_ = RelightCache.load(result)
    check_dataclass(cache_)
    picture = cache_.relight(np.ones((len(result.stage), 3)))
    require(np.isfinite(picture).all(), "a relit picture is not finite")


def read_memory(folder: Path) -> None:
    from facestage.system import native

    with mock.patch.dict(os.environ, FACESTAGE_CACHE=str(folder)):
        check(native._remembered(), list[str], "what native.json remembers")


def read_checkpoint(folder: Path) -> None:
    from facestage.fit.runs.checkpoint import Checkpoint

    found = Checkpoint.load(folder)
    if found is not None:
        check_dataclass(found, but=("camera_to_stage",))


def read_joint_checkpoint(folder: Path) -> None:
    from facestage.fit.runs.joint_checkpoint import JointCheckpoint

    found = JointCheckpoint.load(folder)
    if found is not None:
        check_dataclass(found, but=("photos",))
        for photo in found.photos:
            check_dataclass(photo, but=("camera_to_stage",))


def read_rig_file(folder: Path) -> None:
    from facestage.contract.rig_file import RigFile

    rig = RigFile.load(folder / "rig.npz")
    check_dataclass(rig)
    check(
        {str(index): place for index, place in rig.known_points().items()},
        dict[str, np.ndarray],
        "known points",
    )


def read_any_json(folder: Path) -> None:
    from facestage.contract.files.storage import finite, read_json

    data = read_json(folder / "a.json", "file")
    json.dumps(finite(data), allow_nan=False)


def read_any_arrays(folder: Path) -> None:
    from facestage.contract.files.storage import read_arrays

    for name, array in read_arrays(folder / "a.npz", "file").items():
        require(isinstance(name, str) and isinstance(array, np.ndarray), "an array is none")
        require(not array.dtype.hasobject, "an array holds objects")
