"""Face models: file round trip, triangles of quads, shapes and albedo by hand, and messages."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import read_arrays, write_arrays
from reference.synthetic_face import synthetic_face


@pytest.fixture(scope="module")
def model() -> FaceModel:
    return synthetic_face(12, 14)


def test_round_trip_keeps_everything(tmp_path: Path, model: FaceModel):
    original = replace(model, face_tile=(0.25, 0.5, 0.5), expression_prior="gaussian")
    original.save(tmp_path / "face.npz")
    loaded = FaceModel.load(tmp_path / "face.npz")
    for item in fields(original):
        first, second = getattr(original, item.name), getattr(loaded, item.name)
        if isinstance(first, np.ndarray):
            assert first.dtype == second.dtype
            np.testing.assert_array_equal(first, second)
        elif isinstance(first, dict):
            assert set(first) == set(second)
            for name in first:
                np.testing.assert_array_equal(first[name], second[name])
        else:
            assert first == second, item.name


@pytest.mark.parametrize(
    ("words", "box"),
    [
        ("box", [True] * 3),
        ("gaussian", [False] * 3),
        (("gaussian", "box", "gaussian"), [False, True, False]),
    ],
)
def test_a_prior_for_all_expressions_or_for_each(
    tmp_path: Path, model: FaceModel, words, box: list[bool]
):
    original = replace(model, expression_prior=words)
    original.save(tmp_path / "face.npz")
    loaded = FaceModel.load(tmp_path / "face.npz")
    assert loaded.expression_prior == words
    assert loaded.expression_box.tolist() == box


def test_quads_split_along_the_first_diagonal_and_triangles_stay(model: FaceModel):
    polygons = np.array([[0, 1, 2, 3], [4, 5, 6, -1], [7, 8, 9, 10]], np.int32)
    part = np.array([0, 1, 2], np.uint8)
    small = replace(model, polygons=polygons, polygon_uvs=polygons, polygon_part=part)
    np.testing.assert_array_equal(
        small.triangles, [[0, 1, 2], [0, 2, 3], [4, 5, 6], [7, 8, 9], [7, 9, 10]]
    )
    np.testing.assert_array_equal(small.triangle_part, [0, 0, 1, 2, 2])
    np.testing.assert_array_equal(small.triangle_uvs, small.triangles)


def test_shape_is_the_mean_plus_the_weighted_modes(model: FaceModel):
    identity, expression = np.array([1.0, -2.0, 0, 0.5]), np.array([0.25, 0, 1.0])
    wanted = model.vertices.astype(float)
    for weight, mode in zip(identity, model.identity_basis, strict=True):
        wanted = wanted + weight * mode
    for weight, mode in zip(expression, model.expression_basis, strict=True):
        wanted = wanted + weight * mode
    np.testing.assert_allclose(model.shape(identity, expression), wanted, atol=1e-7)
    np.testing.assert_array_equal(model.shape(), model.vertices)


def test_albedo_is_exponential_in_the_coefficients_and_below_one(model: FaceModel):
    delta = np.array([0.5, -1, 0, 0.3, 0])
    wanted = model.albedo_mean * np.exp(np.tensordot(delta, model.albedo_basis, 1))
    np.testing.assert_allclose(model.albedo(delta), wanted, rtol=1e-5)
    np.testing.assert_allclose(model.albedo(), model.albedo_mean, rtol=1e-6)
    assert model.albedo(np.full(5, 50.0)).max() < 1
    assert model.albedo(np.full(5, -8.0)).min() > 0


def test_landmark_tables(model: FaceModel):
    vertices, weights = model.landmark_vertices("ibug68")
    assert vertices.shape == weights.shape == (68, 3)
    np.testing.assert_allclose(weights.sum(1), 1)
    with pytest.raises(InputError, match="no landmarks of scheme 'mediapipe478'; it has: ibug68"):
        model.landmark_vertices("mediapipe478")


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("vertices", lambda a: a[:, :2], r"vertices has shape .* expected"),
        ("identity_basis", lambda a: a[:, :-1], r"identity_basis has shape .* expected"),
        ("expression_basis", lambda a: a[:-1], r"expression_basis has shape .* expected"),
        ("albedo_mean", lambda a: a * np.nan, "albedo_mean holds NaN"),
        ("albedo_mean", lambda a: a * 0, "albedo_mean"),
        ("albedo_mean", lambda a: a + 1, "albedo_mean"),
        ("polygons", lambda a: a + 1000, "polygons refers to a point outside"),
        ("polygons", lambda a: a - 1, "polygons refers to a point outside"),
        ("polygon_uvs", lambda a: a + 1000, "polygon_uvs refers to a point outside"),
        ("polygon_part", lambda a: a[:-1], "polygon_part has shape"),
        (
            "expression_prior",
            lambda _: "uniform",
            "expression_prior is 'uniform', not box or gaussian",
        ),
        (
            "expression_prior",
            lambda _: ("box", "uniform", "box"),
            "expression_prior is 'uniform', not box or gaussian",
        ),
        ("expression_prior", lambda _: ("box",), "expression_prior has 1 words for 3 expressions"),
    ],
)
def test_wrong_arrays_are_named(model: FaceModel, name: str, change, words: str):
    with pytest.raises(InputError, match=words):
        replace(model, **{name: change(getattr(model, name))})


def test_landmarks_and_regions_outside_the_mesh_are_refused(model: FaceModel):
    table = model.landmarks["ibug68"].copy()
    table[3, 0] = 10**6
    with pytest.raises(InputError, match="ibug68"):
        replace(model, landmarks={"ibug68": table})
    with pytest.raises(InputError, match="narrow_face"):
        replace(model, regions={"narrow_face": np.array([10**6], np.int32)})


def test_a_file_of_something_else_is_refused(tmp_path: Path):
    np.savez(tmp_path / "x.npz", a=np.zeros(3))
    with pytest.raises(InputError, match="lacks vertices"):
        FaceModel.load(tmp_path / "x.npz")


@pytest.mark.parametrize(
    "meta", ["not JSON", json.dumps({"schema": 1}), json.dumps([1]), json.dumps({"schema": 9})]
)
def test_damaged_meta_data_is_refused(tmp_path: Path, model: FaceModel, meta: str):
    path = tmp_path / "face.npz"
    model.save(path)
    write_arrays(path, read_arrays(path, "model") | {"meta": np.array(meta)})
    with pytest.raises(InputError, match=r"face\.npz"):
        FaceModel.load(path)


def test_arrays_of_text_are_refused(tmp_path: Path, model: FaceModel):
    path = tmp_path / "face.npz"
    model.save(path)
    write_arrays(path, read_arrays(path, "model") | {"uvs": np.full(model.uvs.shape, "u")})
    with pytest.raises(InputError):
        FaceModel.load(path)
