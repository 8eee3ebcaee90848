"""The default face laid onto other meshes: onto itself in disguise, and onto ICT-FaceKit's
people.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.contract.errors import InputError
from facestage.contract.face_model import OTHER, SKIN, FaceModel
from facestage.models.correspondence.coarse_alignment import axis_rotation
from facestage.models.correspondence.registration import register
from facestage.models.correspondence.transfer import landmark_tables
from facestage.models.mesh.similarity import Similarity, procrustes
from facestage.models.mesh.surface import Surface
from facestage.models.registry import load_model

CENTIMETRES = 100.0


@pytest.fixture(scope="module")
def default() -> FaceModel:
    return load_model("default")


@pytest.fixture(scope="module")
def person(default: FaceModel) -> np.ndarray:
    """(n, 3) a person of the default model, whose landmarks are therefore known."""
    rng = np.random.default_rng(4)
    return default.shape(0.8 * rng.normal(size=len(default.identity_names))).astype(np.float64)


def places(table: np.ndarray, vertices: np.ndarray) -> np.ndarray:
    return np.einsum("mk,mkc->mc", table[:, 3:], vertices[table[:, :3].astype(int)])


def sphere(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed unit sphere: vertices, triangles."""
    rise, turn = np.meshgrid(
        np.linspace(0, np.pi, rows), np.linspace(0, 2 * np.pi, columns), indexing="ij"
    )
    points = np.stack(
        [np.sin(rise) * np.cos(turn), np.cos(rise), -np.sin(rise) * np.sin(turn)], -1
    ).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = (
        index[:-1, :-1].ravel(),
        index[1:, :-1].ravel(),
        index[1:, 1:].ravel(),
        index[:-1, 1:].ravel(),
    )
    return points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])


def disguised(vertices: np.ndarray) -> np.ndarray:
    """In centimetres, Z up, a little turned, away from the origin."""
    turned = (
        vertices
        @ axis_rotation(2, 4).T
        @ Rotation.from_rotvec(np.array([0.1, 0.15, -0.2])).as_matrix().T
    )
    return CENTIMETRES * turned + [3.0, -7.0, 150.0]


def test_nearest_points_are_those_of_every_triangle():
    rng = np.random.default_rng(0)
    vertices, triangles = sphere(8, 10)
    surface = Surface(vertices, triangles)
    queries = rng.normal(size=(40, 3))
    found = surface.nearest(queries)
    for query, distance in zip(queries, found.distance, strict=True):
        weights = rng.dirichlet(np.ones(3), 400)
        points = np.einsum("sk,tkc->tsc", weights, vertices[triangles]).reshape(-1, 3)
        least = np.linalg.norm(points - query, axis=1).min()
        assert distance <= least + 1e-9
        assert distance > least - 0.05


def test_procrustes_finds_a_similarity():
    rng = np.random.default_rng(1)
    truth = Similarity(
        3.0,
        Rotation.from_rotvec(np.array([0.3, -1.0, 0.5])).as_matrix(),
        np.array([1.0, 2.0, -3.0]),
    )
    points = rng.normal(size=(9, 3))
    found = procrustes(points, truth.apply(points))
    np.testing.assert_allclose(found.rotation, truth.rotation, atol=1e-9)
    np.testing.assert_allclose(found.inverse().apply(truth.apply(points)), points, atol=1e-9)


def test_a_face_is_found_in_any_unit_and_axes(default: FaceModel, person: np.ndarray):
    vertices = disguised(person)
    fit = register(default, vertices, default.triangles)
    assert fit.median_distance < 0.3e-3
    assert fit.covered > 0.9
    assert fit.similarity.scale == pytest.approx(CENTIMETRES, rel=0.15)
    table = landmark_tables(fit, vertices, default.triangles)["ibug68"]
    error = (
        np.linalg.norm(
            places(table, vertices) - places(default.landmarks["ibug68"], vertices), axis=1
        )
        * 10
    )
    print(f"landmarks: median {np.median(error):.2f} mm, worst {error.max():.2f} mm")
    assert np.median(error) < 2.5
    np.testing.assert_allclose(table[:, 3:].sum(axis=1), 1.0, atol=1e-6)


def test_a_mask_inside_out_with_marks(default: FaceModel, person: np.ndarray):
    """Only the face, its triangles turned over; marked landmarks come back exactly, as do all
    schemes.
    """
    inside = np.zeros(len(person), bool)
    inside[default.regions["face"]] = True
    triangles = default.triangles[inside[default.triangles].all(axis=1)][:, ::-1]
    truth = places(default.landmarks["ibug68"], person)
    marks = {index: truth[index] for index in (8, 30, 36, 39, 42, 45, 48, 54)}
    fit = register(default, person, triangles, marks)
    assert not fit.right_side_out
    tables = landmark_tables(fit, person, triangles, marks)
    assert set(tables) == set(default.landmarks)
    error = np.linalg.norm(places(tables["ibug68"], person) - truth, axis=1)
    assert error[list(marks)].max() < 1e-6
    assert np.median(error[17:]) < 2e-3


def test_what_is_no_face_is_refused(default: FaceModel):
    vertices, triangles = sphere(24, 36)
    with pytest.raises(InputError, match="mark some landmarks"):
        register(default, vertices, triangles)


@pytest.mark.parametrize("flaw", ["empty", "NaN"])
def test_broken_meshes_are_refused(default: FaceModel, flaw: str):
    vertices, triangles = sphere(8, 10)
    if flaw == "empty":
        triangles = triangles[:0]
    else:
        vertices = vertices * np.nan
    with pytest.raises(InputError, match=r"no surface|NaN"):
        register(default, vertices, triangles)


@pytest.mark.slow
@pytest.mark.parametrize("number", range(0, 21, 7))
def test_ict_people_are_reached(default: FaceModel, ict_facekit: FaceModel, number: int):
    """ICT-FaceKit's narrow face lies on the fitted default face within 2 mm (median), for the mean
    and some of the 20 people whom it was tried on.
    """
    ict, people = ict_facekit, np.random.default_rng(0).normal(size=(20, 100))
    identity = people[number - 1] if number else np.zeros(100)
    vertices = ict.shape(identity).astype(np.float64)
    fit = register(default, vertices, ict.triangles[ict.triangle_part != OTHER])
    surface = Surface(fit.vertices, default.triangles)
    median = 1e3 * np.median(surface.nearest(vertices[ict.regions["narrow_face"]]).distance)
    print(f"median distance {median:.2f} mm, at most 2")
    assert median <= 2.0


def test_landmarks_of_the_ict_mean_are_found(default: FaceModel, ict_facekit: FaceModel):
    ict = ict_facekit
    truth = ict.landmarks["ibug68"][:, 0].astype(int)
    skin = ict.triangles[ict.triangle_part == SKIN]
    fit = register(default, ict.vertices, skin)
    found = places(
        landmark_tables(fit, ict.vertices, skin)["ibug68"], ict.vertices.astype(np.float64)
    )
    error = 1e3 * np.linalg.norm(found - ict.vertices[truth], axis=1)
    print(f"landmarks of the mean: median {np.median(error[17:]):.2f} mm without the jaw")
    assert np.median(error[17:]) < 4.0
