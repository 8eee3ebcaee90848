"""A sequence's folder comes back as it was, and is refused when it is damaged."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.result_files import is_result_file
from facestage.contract.sequence import ARRAYS, FILE, Sequence
from facestage.contract.wrinkles import Wrinkles


def test_round_trip(sequence: Sequence, tmp_path: Path):
    sequence.write_into(tmp_path)
    loaded = Sequence.load(tmp_path)
    for name in ("identity", "expression", "model_to_camera"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(sequence, name))
    for name in (
        *("status", "advice", "film", "model", "camera", "frame_rate", "frames", "keyframes"),
        *("identity_names", "expression_names", "motion", "errors", "timings"),
    ):
        assert getattr(loaded, name) == getattr(sequence, name), name
    assert loaded.light_radiance is None
    assert set(loaded.deviations) == {"expression", "pose"}
    np.testing.assert_array_equal(loaded.deviations["expression"], 0.1)


def test_light_that_changes_comes_back(sequence: Sequence, tmp_path: Path):
    light = np.arange(3 * 2 * 3.0).reshape(3, 2, 3)
    replace(sequence, light_radiance=light).write_into(tmp_path)
    found = Sequence.load(tmp_path).light_radiance
    assert found is not None
    np.testing.assert_array_equal(found, light)
    arrays = read_arrays(tmp_path / ARRAYS, "sequence's arrays")
    write_arrays(tmp_path / ARRAYS, arrays | {"light_radiance": light[:2]})
    with pytest.raises(InputError, match="light_radiance"):
        Sequence.load(tmp_path)


def test_haemoglobin_comes_back_whole_or_is_refused(sequence: Sequence, tmp_path: Path):
    known: dict[str, Any] = {
        "haemoglobin": np.array([[0.5, 0.0], [1.0, -1.0], [0.0, 2.0]]),
        "haemoglobin_harmonics": np.arange(10.0).reshape(2, 5),
        "haemoglobin_color": np.array([-0.04, -0.09, -0.06]),
    }
    sequence.write_into(tmp_path)
    assert Sequence.load(tmp_path).haemoglobin is None and not Sequence.load(tmp_path).skin
    replace(sequence, skin={"haemoglobin": 0.7}, **known).write_into(tmp_path)
    loaded = Sequence.load(tmp_path)
    assert loaded.skin == {"haemoglobin": 0.7}
    for name, value in known.items():
        np.testing.assert_array_equal(getattr(loaded, name), value)
    arrays = read_arrays(tmp_path / ARRAYS, "sequence's arrays")
    for damaged, words in (
        ({"haemoglobin": known["haemoglobin"][:, :1]}, "haemoglobin"),
        ({"haemoglobin": known["haemoglobin"][:2]}, "haemoglobin"),
        ({"haemoglobin_color": np.zeros(2)}, "haemoglobin_color"),
    ):
        write_arrays(tmp_path / ARRAYS, arrays | damaged)
        with pytest.raises(InputError, match=words):
            Sequence.load(tmp_path)
    del arrays["haemoglobin_color"]
    write_arrays(tmp_path / ARRAYS, arrays)
    with pytest.raises(InputError, match="haemoglobin_color"):
        Sequence.load(tmp_path)


def test_wrinkles_come_back_and_know_their_files(sequence: Sequence, tmp_path: Path):
    smile = Wrinkles("smile_left", sequence.expression_names[:1])
    replace(sequence, wrinkles=(smile,)).write_into(tmp_path)
    assert Sequence.load(tmp_path).wrinkles == (smile,)
    assert smile.normal_file == "wrinkles_smile_left_normal.exr"
    for name in (smile.normal_file, smile.height_file):
        assert is_result_file(Path(name)) and not is_result_file(Path("keyframes/1-a/x") / name)
    data = json.loads((tmp_path / FILE).read_text("utf-8"))
    for wrong, words in (
        ([{"name": "../x", "sliders": ["jawOpen"]}], "small letters"),
        ([{"name": "a", "sliders": ["nose"]}], "follow 'nose', which is no expression"),
        ([{"name": "a", "sliders": []}], "sliders has 0 entries"),
        (2 * data["wrinkles"], "have a name twice"),
    ):
        (tmp_path / FILE).write_text(json.dumps(data | {"wrinkles": wrong}), encoding="utf-8")
        with pytest.raises(InputError, match=words):
            Sequence.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 2}, "schema 2, expected 1"),
        ({"frames": []}, "frames has 0 entries"),
        ({"status": "fine"}, "status is 'fine'"),
        ({"frame_rate": "fast"}, "frame_rate is 'fast'"),
        ({"expression_names": ["jawOpen", "smile"]}, r"expression has shape \(3, 1\)"),
    ],
)
def test_damage_is_named(change: dict, words: str, sequence: Sequence, tmp_path: Path):
    sequence.write_into(tmp_path)
    path = tmp_path / FILE
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=words):
        Sequence.load(tmp_path)


def test_what_is_no_rotation_is_refused(sequence: Sequence, tmp_path: Path):
    sequence.write_into(tmp_path)
    arrays = read_arrays(tmp_path / ARRAYS, "arrays")
    arrays["model_to_camera"][1, 0, 0] = -1
    write_arrays(tmp_path / ARRAYS, arrays)
    with pytest.raises(InputError, match="no rigid transform"):
        Sequence.load(tmp_path)
    with pytest.raises(InputError, match="does not exist"):
        Sequence.load(tmp_path / "nothing")
