"""reflectance.json: what it says is checked."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.light_stage import fibonacci_stage
from facestage.contract.reflectance import FILE, ReflectanceField, is_field

COUNT = 12


def field() -> ReflectanceField:
    half = fibonacci_stage(COUNT // 2).position
    towards = np.concatenate([half, -half])
    return ReflectanceField(
        model="default",
        camera=Camera.default(24, 20),
        camera_to_stage=np.eye(4),
        directions=towards,
        solid_angles=np.full(COUNT, 4 * np.pi / COUNT),
        images=tuple(f"light-{number}.exr" for number in range(COUNT)),
        samples=4,
    )


def test_a_field_comes_back(tmp_path: Path):
    assert not is_field(tmp_path)
    field().write_into(tmp_path)
    assert is_field(tmp_path)
    found = ReflectanceField.load(tmp_path)
    assert found.images == field().images and found.camera == field().camera
    np.testing.assert_allclose(found.directions, field().directions)
    assert json.loads((tmp_path / FILE).read_text())["frame"].startswith("stage: right-handed")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"schema": 2}, "version|schema"),
        ({"images": ["a.exr"] * COUNT}, "twice"),
        ({"images": [f"{n}.exr" for n in range(COUNT + 1)]}, "has 13 entries, expected 12"),
        ({"images": [f"../{n}.exr" for n in range(COUNT)]}, "not in the folder"),
        ({"solid_angles": [1.0] * COUNT}, "sum up to 12.0000, expected 4 pi"),
        ({"directions": [[0.0, 0.0, 2.0]] * COUNT}, "not of length 1"),
        ({"samples": 0}, "samples"),
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, change: dict[str, Any], words: str):
    field().write_into(tmp_path)
    data = json.loads((tmp_path / FILE).read_text())
    (tmp_path / FILE).write_text(json.dumps(data | change))
    with pytest.raises(InputError, match=words):
        ReflectanceField.load(tmp_path)


def test_no_folder_is_no_field(tmp_path: Path):
    with pytest.raises(InputError, match="does not exist"):
        ReflectanceField.load(tmp_path / "gone")
