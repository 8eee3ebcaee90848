"""A sequence's folder comes back as it was, and is refused when it is damaged."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.sequence import ARRAYS, FILE, Sequence, SequenceFrame


@pytest.fixture
def sequence() -> Sequence:
    frames = (
        SequenceFrame(101, 0.0, "a101.png", "seen", "", 1, 0.01, 0.5),
        SequenceFrame(102, 0.04, "a102.png", "lost", "No face was found.", 1),
        SequenceFrame(103, 0.08, "a103.png", "unsure", "A cut.", 2, 0.02, 0.7),
    )
    pose = np.tile(np.eye(4), (3, 1, 1))
    pose[:, 2, 3] = -0.7
    return Sequence(
        "converged",
        "3 frames follow one face.",
        "/films/take.mp4",
        "default",
        Camera(64, 48, 90.0, (32.0, 24.0)),
        25.0,
        frames,
        (101, 103),
        ("a", "b"),
        ("jawOpen",),
        np.array([0.5, -1.0]),
        np.array([[0.0], [0.25], [0.5]]),
        pose,
        {"expression": np.full((3, 1), 0.1), "pose": np.zeros((3, 6))},
        {"mouth": 0.02},
        {"similarity_mm": 0.8},
        {"landmarks": 1.5},
    )


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
