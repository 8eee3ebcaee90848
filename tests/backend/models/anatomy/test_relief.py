"""Relief: as large, as smooth and where it is said to be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.face_model import FaceModel
from facestage.models.anatomy import relief
from facestage.models.anatomy.relief import LENGTH_MM, RELIEF_MM, relief_basis
from facestage.models.mesh.surface import vertex_normals
from facestage.models.registry import load_model


@pytest.fixture(scope="module")
def head() -> FaceModel:
    return load_model("default")


@pytest.fixture(scope="module")
def basis(head: FaceModel) -> np.ndarray:
    return 1e3 * relief_basis(head).astype(np.float64)


def test_it_is_as_large_as_said_in_the_middle_of_the_face(head: FaceModel, basis: np.ndarray):
    middle = np.linalg.norm(head.vertices * [1, 1, 0], axis=1) < 0.04
    skin = np.isin(np.arange(len(head.vertices)), head.regions["narrow_face"]) & middle
    deviation = np.sqrt((basis[:, skin] ** 2).sum(axis=(0, 2)))
    print(f"{np.median(deviation):.2f} mm, said {RELIEF_MM} mm")
    assert np.median(deviation) == pytest.approx(RELIEF_MM, rel=0.15)


def test_it_moves_the_skin_of_the_face_along_its_normals(head: FaceModel, basis: np.ndarray):
    moved = np.flatnonzero((basis**2).sum(axis=(0, 2)) > 0)
    assert np.isin(moved, head.regions["face"]).all()
    normals = vertex_normals(head.vertices, head.triangles[head.triangle_part == 0])[moved]
    along = np.einsum("rnx,nx->rn", basis[:, moved], normals)
    np.testing.assert_allclose(np.linalg.norm(basis[:, moved], axis=2), np.abs(along), atol=1e-5)


def test_it_fades_towards_the_border_of_the_face(head: FaceModel, basis: np.ndarray):
    face = np.zeros(len(head.vertices), bool)
    face[head.regions["face"]] = True
    skin = head.triangles[head.triangle_part == 0]
    leaving = skin[face[skin].any(axis=1) & ~face[skin].all(axis=1)]
    assert len(leaving) and not basis[:, np.unique(leaving)].any()


def test_neighbours_move_alike_and_distant_places_do_not(head: FaceModel, basis: np.ndarray):
    """On the forehead, whose surface is nearly flat."""
    millimetres = 1e3 * head.vertices.astype(float)
    heights = np.linalg.norm(basis, axis=2) * np.sign(basis[:, :, 2])
    skin = head.regions["narrow_face"]
    skin = skin[(heights[:, skin] ** 2).sum(axis=0) > 0.3 * RELIEF_MM**2]
    covariance = heights[:, skin].T @ heights[:, skin]
    place = millimetres[skin]
    centre = np.argmin(np.linalg.norm(place - place[place[:, 1].argmax()] + [0, 15, 0], axis=1))
    correlation = covariance[centre] / np.sqrt(np.diag(covariance) * covariance[centre, centre])
    distance = np.linalg.norm(place - place[centre], axis=1)
    near, far = distance < 0.3 * LENGTH_MM, distance > 3 * LENGTH_MM
    between = np.abs(distance / LENGTH_MM - 1) < 0.2
    assert near.sum() > 1 and correlation[near].min() > 0.85
    assert correlation[between].mean() == pytest.approx(np.exp(-0.5), abs=0.1)
    assert np.abs(correlation[far]).max() < 0.35


def test_a_mesh_too_coarse_for_any_has_none(head: FaceModel, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(relief, "VERTICES_PER_MODE", 10**6)
    assert relief_basis(replace(head)).shape == (0, len(head.vertices), 3)
