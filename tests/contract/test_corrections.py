"""What an artist corrected, as a file."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.corrections import Correction, joined, read_corrections, write_corrections
from facestage.contract.errors import InputError
from facestage.contract.sequence import Sequence

POSE = np.array([[0.0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, -0.7], [0, 0, 0, 1]])


def test_round_trip_in_the_order_of_the_frames(tmp_path: Path):
    path = tmp_path / "corrections.json"
    given = [Correction(12, {}, POSE), Correction(7, {"jawOpen": 0.25})]
    write_corrections(path, given)
    first, second = read_corrections(path)
    assert (first.frame, first.weights, first.model_to_camera) == (7, {"jawOpen": 0.25}, None)
    assert second.weights == {} and second.model_to_camera is not None
    np.testing.assert_array_equal(second.model_to_camera, POSE)


def test_later_ones_hold_where_both_say_something():
    earlier = [Correction(7, {"a": 0.1, "b": 0.2}, POSE), Correction(9, {"a": 0.3})]
    found = joined(earlier, [Correction(7, {"b": 0.5})])
    assert [each.frame for each in found] == [7, 9]
    assert found[0].weights == {"a": 0.1, "b": 0.5} and found[0].model_to_camera is POSE


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"schema": 2, "frames": []}, "schema 2, expected 1"),
        ({"schema": 1, "frames": []}, "has 0 entries"),
        ({"schema": 1, "frames": [{"frame": 1, "weight": {}}]}, "weight"),
        ({"schema": 1, "frames": [{"frame": -1}]}, "frame is -1"),
        ({"schema": 1, "frames": [{"frame": 1, "weights": {"a": "b"}}]}, "a is 'b'"),
        (
            {"schema": 1, "frames": [{"frame": 1, "model_to_camera": (2 * POSE).tolist()}]},
            "not a rigid",
        ),
    ],
)
def test_what_is_wrong_is_named(data: dict[str, Any], words: str, tmp_path: Path):
    path = tmp_path / "corrections.json"
    path.write_text(json.dumps(data))
    with pytest.raises(InputError, match=words):
        read_corrections(path)


def test_a_sequence_keeps_them(sequence: Sequence, tmp_path: Path):
    sequence.write_into(tmp_path)
    assert "corrected" not in (tmp_path / "sequence.json").read_text()
    assert Sequence.load(tmp_path).corrected == ()
    replace(sequence, corrected=(Correction(102, {"jawOpen": 0.5}, POSE),)).write_into(tmp_path)
    (found,) = Sequence.load(tmp_path).corrected
    assert found.frame == 102 and found.weights == {"jawOpen": 0.5}
    assert found.model_to_camera is not None
    np.testing.assert_array_equal(found.model_to_camera, POSE)
