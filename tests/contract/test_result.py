"""Results: folder round trip, and messages for what is missing."""

from __future__ import annotations

import json
from dataclasses import fields, replace
from pathlib import Path

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
