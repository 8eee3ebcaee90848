"""Face models: file round trip, triangles of quads, shapes and albedo by hand, and messages."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

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
    polygons = np.array([[1, 2, 3, 0], [4, 5, 6, -1], [7, 8, 9, 10]], np.int32)
    part = np.array([0, 1, 2], np.uint8)
    small = replace(model, polygons=polygons, polygon_uvs=polygons, polygon_part=part)
    np.testing.assert_array_equal(
        small.triangles, [[1, 2, 3], [1, 3, 0], [4, 5, 6], [7, 8, 9], [7, 9, 10]]
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


def corner(array: np.ndarray, row: int, column: int, value: int) -> Any:
    """The array with one other entry."""
    changed = array.copy()
    changed[row, column] = value
    return changed


@pytest.mark.parametrize("name", ["polygons", "polygon_uvs"])
def test_a_corner_is_a_point_of_the_mesh_and_only_the_fourth_may_be_none(
    model: FaceModel, name: str
):
    array, count = getattr(model, name), len(model.vertices)
    # Of a quad: its fourth corner must be one in the other array too.
    for column, value, right in (
        (0, count - 1, True),
        (0, count, False),
        (2, 0, True),
        (2, -1, False),
        (3, 0, True),
        (3, -2, False),
    ):
        changed = {name: corner(array, 5, column, value)}
        if right:
            replace(model, **changed)
            continue
        with pytest.raises(InputError, match=f"{name} refers to a point outside 0..{count - 1}."):
            replace(model, **changed)
    with pytest.raises(InputError, match="polygon_uvs has triangles where polygons has quads"):
        replace(model, **{name: corner(array, 5, 3, -1)})


def test_an_albedo_lies_between_black_and_white(model: FaceModel):
    for value, right in ((1e-6, True), (0.999999, True), (0.0, False), (1.0, False)):
        changed = corner(model.albedo_mean, 7, 1, 0)
        changed[7, 1] = value
        if right:
            replace(model, albedo_mean=changed)
            continue
        with pytest.raises(
            InputError, match=r"albedo_mean runs from .* expected values between 0 and 1"
        ):
            replace(model, albedo_mean=changed)


def landmark(
    model: FaceModel, vertices: tuple[int, int, int], weights: tuple[float, float, float]
) -> FaceModel:
    return replace(model, landmarks={"one": np.array([[*vertices, *weights]])})


def test_a_landmark_lies_about_a_triangle_of_the_mesh(model: FaceModel):
    last = len(model.vertices) - 1
    for weights in ((1, 0, 0), (0.5, 0.509, 0), (0.5, 0.491, 0), (10, -9, 0), (-9, 10, 0)):
        indices, found = landmark(model, (0, 1, last), weights).landmark_vertices("one")
        np.testing.assert_array_equal(indices, [[0, 1, last]])
        np.testing.assert_array_equal(found, np.array([weights], np.float32))
    for weights in ((0.5, 0.511, 0), (0.5, 0.489, 0), (10.1, -9.1, 0), (-10.1, 11.1, 0)):
        with pytest.raises(InputError, match="'one' have weights that do not add up to 1"):
            landmark(model, (0, 1, last), weights)
    for vertices in ((0, 1, last + 1), (-1, 0, 1)):
        with pytest.raises(InputError, match=f"'one' refer to a point outside 0..{last}."):
            landmark(model, vertices, (1, 0, 0))
    for shape in ((6,), (1, 5), (1, 1, 6)):
        with pytest.raises(InputError, match="'one' refer to a point"):
            replace(model, landmarks={"one": np.zeros(shape)})
    assert replace(model, landmarks={"one": np.zeros((0, 6))}).landmark_vertices("one")[
        0
    ].shape == (0, 3)


def test_a_region_is_of_the_meshs_vertices(model: FaceModel):
    last = len(model.vertices) - 1
    for indices in ([0, last], []):
        replace(model, regions={"brow": np.array(indices, int)})
    for indices in ([-1], [last + 1]):
        with pytest.raises(InputError, match=f"region 'brow' refers to a point outside 0..{last}."):
            replace(model, regions={"brow": np.array(indices)})


def test_by_itself_a_model_has_boxed_expressions_and_fills_its_atlas(model: FaceModel):
    given = {item.name: getattr(model, item.name) for item in fields(model)}
    for name in ("regions", "expression_prior", "face_tile"):
        del given[name]
    plain = FaceModel(**given)
    assert (
        plain.expression_prior == "box"
        and plain.face_tile == (0.0, 0.0, 1.0)
        and plain.regions == {}
    )


def test_the_brightest_albedo_is_that_of_the_contract(model: FaceModel):
    assert model.albedo(np.full(5, 50.0)).max() == np.float32(0.999)


@pytest.mark.parametrize(
    ("name", "right", "wrong"),
    [
        ("vertices", [-1e9, 1e9], [-1.1e9, 1.1e9]),
        ("uvs", [-1.0, 2.0], [-1.01, 2.01]),
        ("identity_basis", [-1e9, 1e9], [-1.1e9, 1.1e9]),
        ("expression_basis", [-1e9, 1e9], [-1.1e9, 1.1e9]),
        ("albedo_basis", [-1e3, 1e3], [-1.01e3, 1.01e3]),
        ("polygon_part", [0, 4], [5]),
    ],
)
def test_limits_of_arrays(
    tmp_path: Path, model: FaceModel, name: str, right: list[float], wrong: list[float]
):
    for value in (*right, *wrong):
        array = getattr(model, name).copy()
        array.flat[7] = value
        replace(model, **{name: array}).save(tmp_path / "face.npz")
        if value in right:
            FaceModel.load(tmp_path / "face.npz")
            continue
        with pytest.raises(InputError, match=f"{name} holds "):
            FaceModel.load(tmp_path / "face.npz")


@pytest.mark.parametrize("tile", [(0.0, 0.0), (0.0, 0.0, 1.0, 1.0), (0.0, 0.0, 1.1e3)])
def test_a_tile_is_three_numbers(tmp_path: Path, model: FaceModel, tile: tuple):
    path = tmp_path / "face.npz"
    model.save(path)
    arrays = read_arrays(path, "model")
    meta = json.loads(str(arrays["meta"])) | {"face_tile": tile}
    write_arrays(path, arrays | {"meta": np.array(json.dumps(meta))})
    with pytest.raises(InputError, match="its meta: face_tile"):
        FaceModel.load(path)


def test_a_file_with_a_word_that_is_no_prior_says_which_there_are(tmp_path: Path, model: FaceModel):
    path = tmp_path / "face.npz"
    model.save(path)
    arrays = read_arrays(path, "model")
    meta = json.loads(str(arrays["meta"]))
    for prior, words in (("flat", "is 'flat'"), (["box", "flat", "box"], r"\[1\] is 'flat'")):
        write_arrays(
            path, arrays | {"meta": np.array(json.dumps(meta | {"expression_prior": prior}))}
        )
        with pytest.raises(
            InputError, match=f"its meta: expression_prior ?{words}, expected one of box, gaussian"
        ):
            FaceModel.load(path)
    del meta["expression_prior"]
    write_arrays(path, arrays | {"meta": np.array(json.dumps(meta))})
    with pytest.raises(
        InputError,
        match="its meta lacks expression_prior, expected box or gaussian, or a list of them",
    ):
        FaceModel.load(path)
