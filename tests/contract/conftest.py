"""Example objects of the contract."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import FROZEN, OFF, fibonacci_stage
from facestage.contract.result import CONVERGED, Result
from facestage.contract.sequence import Sequence, SequenceFrame
from reference.contract_files import full_job


def rigid(seed: int) -> np.ndarray:
    """A random rigid 4x4 transform."""
    random = np.random.default_rng(seed)
    rotation, _ = np.linalg.qr(random.normal(size=(3, 3)))
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.sign(np.linalg.det(rotation))
    matrix[:3, 3] = random.normal(size=3)
    return matrix


@pytest.fixture
def landmarks() -> Landmarks:
    random = np.random.default_rng(1)
    visible = random.random(68) > 0.2
    return Landmarks("ibug68", random.uniform(10, 90, (68, 2)), visible)


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    path = tmp_path / "Some Photo.PNG"
    path.write_bytes(b"not decoded by the contract")
    return path


@pytest.fixture
def job(photo: Path, landmarks: Landmarks) -> Job:
    stage = fibonacci_stage(5, radiance=2.5)
    stage = replace(stage, state=np.array([0, FROZEN, OFF, 0, 0])).with_radiance(stage.radiance)
    return full_job(
        photo,
        rigid(3),
        landmarks=landmarks,
        camera=Camera(96, 80, 123.25, (47.5, 41.0)),
        stage=stage,
    )


@pytest.fixture
def result() -> Result:
    random = np.random.default_rng(2)
    half: Any = np.float64(0.5)  # a number as numpy computes it
    return Result(
        status=CONVERGED,
        advice="Converged.",
        model="default",
        camera=Camera(96, 80, 123.25, (47.5, 41.0)),
        camera_to_stage=rigid(4),
        model_to_camera=rigid(5),
        identity=random.normal(size=3),
        expression=random.random(2),
        albedo=random.normal(size=4),
        specular=random.random((8, 8)),
        roughness=0.37,
        stage=fibonacci_stage(3, radiance=0.1),
        vertices=random.normal(size=(9, 3)).astype(np.float32),
        triangles=random.integers(0, 9, (5, 3)).astype(np.int32),
        identity_names=("wide", "tall", "long"),
        expression_names=("jawOpen", "smile"),
        energy={"photo": 1.5, "landmarks": half},
        errors={"psnr": 31.0},
        timings={"render": 0.25},
        left_out=[{"what": "2 lights", "why": "off", "saved": "time"}],
        versions={"numpy": "1"},
        seed=3,
        arrays={"condition": np.asarray(17.0 * (half + half))},
    )


@pytest.fixture
def sequence() -> Sequence:
    frames = (
        SequenceFrame(101, 0.0, "a101.png", "seen", "", 1, 0.01, 0.5),
        SequenceFrame(102, 0.04, "a102.png", "lost", "No face was found.", 1),
        SequenceFrame(103, 0.08, "a103.png", "unsure", "A cut.", 2, 0.02, 0.7),
    )
    pose = np.tile(np.eye(4), (3, 1, 1))
    pose[:, 2, 3] = -0.7
    return Sequence(
        "converged",
        "3 frames follow one face.",
        "/films/take.mp4",
        "default",
        Camera(64, 48, 90.0, (32.0, 24.0)),
        25.0,
        frames,
        (101, 103),
        ("a", "b"),
        ("jawOpen",),
        np.array([0.5, -1.0]),
        np.array([[0.0], [0.25], [0.5]]),
        pose,
        {"expression": np.full((3, 1), 0.1), "pose": np.zeros((3, 6))},
        {"mouth": 0.02},
        {"similarity_mm": 0.8},
        {"landmarks": 1.5},
    )
