"""A face model laid onto a scan of one of its own people."""

from __future__ import annotations

from types import ModuleType

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.landmarks import Landmarks
from facestage.contract.scan import Scan
from facestage.models.registry import load_model
from facestage.render.variant import start_renderer

CAMERA = Camera(512, 512, 1200.0, (256.0, 256.0))
PLACE = np.array([10.0, -20.0, -900.0])  # mm


@pytest.fixture
def register(tools: None) -> ModuleType:
    """The module tools/register_to_scan.py."""
    import register_to_scan

    return register_to_scan


@pytest.fixture(scope="module")
def model() -> FaceModel:
    return load_model("default")


@pytest.fixture(scope="module")
def scan(model: FaceModel) -> Scan:
    """A person whom a few modes tell from the mean."""
    identity = np.zeros(len(model.identity_names))
    identity[:6] = [1.5, -1.0, 1.0, -1.5, 1.0, 0.8]
    vertices = 1e3 * model.shape(identity).astype(np.float64) + PLACE
    return Scan(vertices, model.triangles, model.regions["narrow_face"])


def true_marks(model: FaceModel, scan: Scan) -> np.ndarray:
    corners, weights = model.landmark_vertices("ibug68")
    marks = np.einsum("mi,mix->mx", weights, scan.vertices[corners])
    marks[:27] = np.nan  # jaw and brows
    return marks


def test_a_person_of_the_model_is_found(register: ModuleType, model: FaceModel, scan: Scan) -> None:
    registration = register.Registration(model, scan, true_marks(model, scan))
    region = model.regions["narrow_face"]

    def off(laid) -> float:
        return float(np.median(np.linalg.norm((laid.vertices - scan.vertices)[region], axis=1)))

    assert off(registration.start()) > 1.4
    assert off(registration.solved()) < 0.2


def test_marks_in_the_photo_are_lifted_to_the_scan(
    register: ModuleType, model: FaceModel, scan: Scan
) -> None:
    start_renderer("cpu")
    marks = true_marks(model, scan)
    # Beside the vertices: through one a ray may slip.
    pixels = CAMERA.project(1e-3 * marks) + np.array([0.05, 0.03])
    pixels[30] = [3.0, 3.0]  # beside the head
    visible = np.ones(68, bool)
    visible[33] = False
    found = register.lifted(Landmarks("ibug68", pixels, visible), CAMERA, scan)
    assert np.isnan(found[[0, 30, 33]]).all()
    nose = [27, 28, 29, 31, 35]
    np.testing.assert_allclose(found[nose], marks[nose], atol=0.5)


def test_a_handful_of_marks_is_too_few(register: ModuleType, model: FaceModel, scan: Scan) -> None:
    marks = true_marks(model, scan)
    marks[31:] = np.nan
    with pytest.raises(InputError, match="at least 6"):
        register.Registration(model, scan, marks)
