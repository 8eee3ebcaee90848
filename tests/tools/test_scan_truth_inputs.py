"""The truth that an ablation gives a fit, on a head that was registered to itself."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.scan import Scan
from facestage.models.registry import load_model

CAMERA = Camera(256, 256, 600.0, (128.0, 128.0))
TURN = Rotation.from_euler("y", 30, degrees=True).as_matrix()
PLACE = np.array([0.01, -0.02, -0.9])  # m


@pytest.fixture
def inputs(tools: None) -> ModuleType:
    """The module tools/scan_truth_inputs.py."""
    import scan_truth_inputs

    return scan_truth_inputs


@pytest.fixture(scope="module")
def model() -> FaceModel:
    return load_model("default")


@pytest.fixture
def registration(model: FaceModel, tmp_path: Path) -> Path:
    """A head that is its own scan, in millimetres."""
    identity = np.random.default_rng(0).normal(size=len(model.identity_names))
    vertices = 1e3 * model.shape(identity)
    path = tmp_path / "registered.npz"
    np.savez(
        path,
        identity=identity,
        expression=np.zeros(len(model.expression_names)),
        vertices=vertices,
        scan=vertices,
    )
    return path


def photographed(vertices_mm: np.ndarray) -> Scan:
    """The scan where a photo's camera saw it."""
    vertices = vertices_mm @ TURN.T + 1e3 * PLACE
    return Scan(vertices, np.array([[0, 1, 2]]), np.arange(3))


def test_the_head_goes_where_its_scan_is(
    inputs: ModuleType, model: FaceModel, registration: Path
) -> None:
    known = inputs.Registered.load(registration, model)
    placed = known.in_photo(photographed(known.scan), model)
    pose = placed.initial["model_to_camera"]
    np.testing.assert_allclose(pose[:3, :3], TURN, atol=1e-5)
    np.testing.assert_allclose(pose[:3, 3], PLACE, atol=1e-5)
    np.testing.assert_allclose(
        placed.vertices, model.shape(known.identity) @ TURN.T + PLACE, atol=1e-5
    )


def test_landmarks_are_where_the_head_is_and_show_on_the_near_side(
    inputs: ModuleType, model: FaceModel, registration: Path
) -> None:
    known = inputs.Registered.load(registration, model)
    landmarks = known.in_photo(photographed(known.scan), model).landmarks(CAMERA)
    corners, weights = model.landmark_vertices("mediapipe478")
    points = np.einsum("mi,mix->mx", weights, model.shape(known.identity)[corners])
    np.testing.assert_allclose(landmarks.points, CAMERA.project(points @ TURN.T + PLACE), atol=1e-2)
    # Turned to the left of the picture's viewer, the head hides its right ear's side (234) alone.
    assert landmarks.visible[454] != landmarks.visible[234]
    assert landmarks.visible[4]
    assert not landmarks.visible[inputs.FIRST_IRIS :].any()


def test_another_scan_is_refused(inputs: ModuleType, model: FaceModel, registration: Path) -> None:
    known = inputs.Registered.load(registration, model)
    with pytest.raises(InputError, match="not the registered one"):
        known.in_photo(photographed(1.01 * known.scan), model)
    with pytest.raises(InputError, match="vertices"):
        known.in_photo(photographed(known.scan[:-1]), model)


def test_its_color_is_the_mean(inputs: ModuleType, model: FaceModel, registration: Path) -> None:
    known = inputs.Registered.load(registration, model)
    scan = photographed(known.scan)
    with pytest.raises(InputError, match="albedo"):
        known.in_photo(scan, model).colored()
    red = np.tile([2.0, 0.3, 0.0], (len(model.vertices), 1))
    colored = replace(known, albedo=red).in_photo(scan, model).colored()
    np.testing.assert_allclose(colored.albedo_mean[0], [0.95, 0.3, 0.02], atol=1e-6)


def test_a_registration_of_another_model_is_refused(
    inputs: ModuleType, model: FaceModel, tmp_path: Path
) -> None:
    path = tmp_path / "other.npz"
    np.savez(
        path,
        identity=np.zeros(3),
        expression=np.zeros(1),
        vertices=np.zeros((4, 3)),
        scan=np.zeros((4, 3)),
    )
    with pytest.raises(InputError, match="identity"):
        inputs.Registered.load(path, model)
