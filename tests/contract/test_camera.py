"""Camera: file round trip, projection known by hand, and messages for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from facestage.contract.camera import Camera
from facestage.contract.errors import InputError

GOOD = {"width": 64, "height": 48, "focal_px": 80.0, "principal_px": [32.0, 24.0]}


@given(
    st.integers(1, 16384),
    st.integers(1, 8192),
    st.floats(1e-3, 1e6),
    st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)),
)
def test_json_round_trip(width: int, height: int, focal: float, principal: tuple[float, float]):
    camera = Camera(width, height, focal, principal)
    assert Camera.from_json(json.loads(json.dumps(camera.to_json()))) == camera


def test_reads_the_documented_file(tmp_path: Path):
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(GOOD))
    assert Camera.read(path) == Camera(64, 48, 80.0, (32.0, 24.0))


def test_projects_with_x_right_and_y_down():
    camera = Camera(64, 48, 80.0, (32.0, 24.0))
    points = np.array([[0, 0, -2.0], [0.5, 0, -2.0], [0, 0.5, -2.0], [0, 0, 1.0]])
    pixels = camera.project(points)
    np.testing.assert_allclose(pixels[:3], [[32, 24], [52, 24], [32, 4]])
    assert np.isnan(pixels[3]).all(), "a point behind the camera has no pixel"


@given(st.floats(0.25, 1.0))
def test_scaled_camera_projects_to_scaled_pixels(factor: float):
    camera = Camera(640, 480, 800.0, (321.0, 238.0))
    points = np.random.default_rng(0).normal(size=(9, 3)) - [0, 0, 5]
    np.testing.assert_allclose(
        camera.scaled(factor).project(points), factor * camera.project(points)
    )


def test_default_is_a_centred_50_mm_lens():
    camera = Camera.default(360, 720)
    assert camera.principal_px == (180.0, 360.0)
    assert camera.focal_px == pytest.approx(720 * 50 / 36)
    assert Camera.default(360, 720, 500.0).focal_px == 500.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"width": 0}, ["width is 0", "expected a whole number of 1 to 16384"]),
        ({"height": 70000}, ["height is 70000", "1 to 16384"]),
        ({"focal_px": 0}, ["focal_px is 0", "a number of 0.001 to"]),
        ({"focal_px": float("nan")}, ["focal_px is nan", "a number of 0.001 to"]),
        ({"focal_px": "wide"}, ["focal_px is 'wide'", "a number"]),
        ({"principal_px": [1, float("inf")]}, ["principal_px[1] is inf"]),
        ({"principal_px": [1, 2, 3]}, ["principal_px has 3 entries", "2 to 2"]),
        ({"principal_px": None}, ["principal_px is null", "list"]),
        ({"width": float("inf")}, ["width is inf"]),
        ({"width": None}, ["width is null"]),
        ({"width": True}, ["width is true"]),
        ({"width": "64"}, ["width is '64'"]),
        ({"width": 64.5}, ["width is 64.5"]),
        ({"width": 10**5000}, ["width is a number of 16610 bits"]),
        (
            {"width": 16384, "height": 16384},
            ["16384 x 16384", "268 million", "at most 134 million"],
        ),
    ],
)
def test_wrong_values_are_named(change: dict, words: list[str]):
    with pytest.raises(InputError) as caught:
        Camera.from_json(GOOD | change)
    for word in words:
        assert word in str(caught.value)


@pytest.mark.parametrize("key", list(GOOD))
def test_missing_keys_are_named(key: str):
    with pytest.raises(InputError, match=key):
        Camera.from_json({name: value for name, value in GOOD.items() if name != key})
