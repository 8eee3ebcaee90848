"""Results: folder round trip, and messages for what is missing."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.light_stage import LightStage
from facestage.contract.result import Result


def test_round_trip_keeps_everything(tmp_path: Path, result: Result):
    result.write_into(tmp_path)
    loaded = Result.load(tmp_path)
    assert loaded.folder == tmp_path
    for item in fields(result):
        first, second = getattr(result, item.name), getattr(loaded, item.name)
        if item.name == "folder":
            continue
        if isinstance(first, LightStage):
            for name in first.__dataclass_fields__:
                np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        elif isinstance(first, np.ndarray):
            np.testing.assert_array_equal(first, second, err_msg=item.name)
        else:
            assert first == second, item.name


def test_the_json_names_every_weight_and_light(tmp_path: Path, result: Result):
    result.write_into(tmp_path)
    data = json.loads((tmp_path / "result.json").read_text())
    assert list(data["identity"]) == list(result.identity_names)
    assert data["expression"]["jawOpen"] == result.expression[0]
    assert (
        len(data["lights"]) == 3
        and data["lights"][1]["radiance"] == result.stage.radiance[1].tolist()
    )
    np.testing.assert_allclose(data["pose"]["model_to_camera"], result.model_to_camera)


def test_an_error_that_is_no_number_is_written_as_null_and_not_read(tmp_path: Path, result: Result):
    replace(result, errors={"psnr": float("nan"), "albedo": 0.5}).write_into(tmp_path)
    assert json.loads((tmp_path / "result.json").read_text())["errors"] == {
        "psnr": None,
        "albedo": 0.5,
    }
    assert Result.load(tmp_path).errors == {"albedo": 0.5}


def test_model_to_stage_chains_the_transforms(result: Result):
    point = np.array([0.01, 0.02, 0.03, 1.0])
    np.testing.assert_allclose(
        result.model_to_stage @ point,
        result.camera_to_stage @ (result.model_to_camera @ point),
        atol=1e-12,
    )


def test_missing_folder_and_files_are_named(tmp_path: Path, result: Result):
    with pytest.raises(InputError, match=r"result folder '.*nothing' does not exist; run a fit"):
        Result.load(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"result\.json' does not exist"):
        Result.load(tmp_path)
    result.write_into(tmp_path)
    (tmp_path / "result.npz").unlink()
    with pytest.raises(InputError, match=r"result\.npz' does not exist"):
        Result.load(tmp_path)


@pytest.mark.parametrize(
    "key",
    ["status", "advice", "model", "camera", "identity", "energy", "errors", "left_out", "seed"],
)
def test_a_missing_key_is_named(tmp_path: Path, result: Result, key: str):
    result.write_into(tmp_path)
    data = json.loads((tmp_path / "result.json").read_text())
    del data[key]
    (tmp_path / "result.json").write_text(json.dumps(data))
    with pytest.raises(InputError, match=f"damaged.*lacks {key}"):
        Result.load(tmp_path)


@pytest.mark.parametrize("name", ["vertices", "camera_to_stage", "stage/radiance", "specular"])
def test_a_missing_array_is_named(tmp_path: Path, result: Result, name: str):
    result.write_into(tmp_path)
    arrays = read_arrays(tmp_path / "result.npz", "arrays")
    del arrays[name]
    write_arrays(tmp_path / "result.npz", arrays)
    with pytest.raises(InputError, match=f"damaged.*lacks {name.replace('/', '.')}"):
        Result.load(tmp_path)


def test_another_schema_is_refused(tmp_path: Path, result: Result):
    result.write_into(tmp_path)
    data = json.loads((tmp_path / "result.json").read_text())
    (tmp_path / "result.json").write_text(json.dumps(data | {"schema": 2}))
    with pytest.raises(InputError, match="schema 2, expected 1"):
        Result.load(tmp_path)


def tampered(folder: Path, **arrays: np.ndarray) -> None:
    path = folder / "result.npz"
    write_arrays(
        path,
        read_arrays(path, "arrays")
        | {name.replace("__", "/"): array for name, array in arrays.items()},
    )


@pytest.mark.parametrize(
    ("name", "right", "wrong"),
    [
        ("albedo", [[1e6], [-1e6], []], [[1.1e6], [-1.1e6]]),
        ("specular", [[[0.0]], [[100.0]]], [[[-0.01]], [[100.1]], np.zeros((0, 0))]),
        ("roughness", [0.0, 1.0], [-0.01, 1.01]),
        ("triangles", [[[0, 1, 8]], np.zeros((0, 3), int)], [[[0, 1, 9]], [[-1, 1, 8]]]),
        (
            "extra__vertex_deviation_mm",
            [np.full((9, 3), np.inf)],
            [np.zeros((9, 2)), np.zeros((8, 3))],
        ),
        (
            "extra__relief",
            [np.full((9, 3), 1e-3)],
            [np.zeros((8, 3)), np.full((9, 3), np.nan), np.full((9, 3), 1e30)],
        ),
    ],
)
def test_limits_of_the_arrays(tmp_path: Path, result: Result, name: str, right: list, wrong: list):
    """Of what a fit can reach; of a mesh of nine vertices."""
    result.write_into(tmp_path)
    for value in right:
        tampered(tmp_path, **{name: np.array(value)})
        loaded = Result.load(tmp_path)
        found = (
            loaded.arrays[name.removeprefix("extra__")]
            if name.startswith("extra")
            else getattr(loaded, name)
        )
        np.testing.assert_array_equal(found, value)
    for value in wrong:
        tampered(tmp_path, **{name: np.array(value)})
        with pytest.raises(InputError, match=f"damaged.*{name.split('__')[-1]}"):
            Result.load(tmp_path)


def test_a_face_has_a_triangle_at_least(tmp_path: Path, result: Result):
    for count in (3, 2):
        few = replace(
            result,
            vertices=result.vertices[:count],
            triangles=np.array([[0, 1, count - 1]], np.int32),
        )
        few.write_into(tmp_path)
        if count == 3:
            assert len(Result.load(tmp_path).vertices) == 3
            continue
        with pytest.raises(InputError, match="vertices from 3 to 5000000"):
            Result.load(tmp_path)


@pytest.mark.parametrize("name", ["identity", "expression"])
def test_both_files_have_the_same_weights_to_what_text_keeps(
    tmp_path: Path, result: Result, name: str
):
    weights: Any = np.array([1000.0, *getattr(result, name)[1:]])
    replace(result, **{name: weights}).write_into(tmp_path)
    for factor, same in ((1 + 0.9e-5, True), (1 - 0.9e-5, True), (1 + 1.1e-5, False)):
        tampered(tmp_path, **{name: weights * factor})
        if same:
            Result.load(tmp_path)
            continue
        with pytest.raises(InputError, match=f"have another {name}; run the fit again"):
            Result.load(tmp_path)
    # Where a weight is 0, a ten-millionth.
    replace(result, **{name: 0 * weights}).write_into(tmp_path)
    tampered(tmp_path, **{name: np.full(len(weights), 0.9e-7)})
    Result.load(tmp_path)
    tampered(tmp_path, **{name: np.full(len(weights), 1.1e-7)})
    with pytest.raises(InputError, match=f"have another {name}"):
        Result.load(tmp_path)


def test_what_older_results_lack_is_empty_and_what_they_have_is_a_list(
    tmp_path: Path, result: Result
):
    replace(result, unobserved={"lights": ["light 0 red"]}).write_into(tmp_path)
    loaded = Result.load(tmp_path)
    assert loaded.unobserved == {"lights": ["light 0 red"]} and type(loaded.left_out) is list
    path = tmp_path / "result.json"
    data = json.loads(path.read_text())
    for name in ("unobserved", "null_directions", "photo", "model_origin"):
        del data[name]
    path.write_text(json.dumps(data))
    loaded = Result.load(tmp_path)
    assert loaded.unobserved == loaded.null_directions == loaded.photo == loaded.model_origin == {}
