"""Landmarks: file round trip, hidden points, and messages for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from facestage.contract.errors import InputError
from facestage.contract.landmarks import SCHEME_SIZES, Landmarks

POINTS = np.random.default_rng(0).uniform(10, 90, (68, 2)).tolist()
GOOD: dict[str, Any] = {"scheme": "ibug68", "points": POINTS, "visible": [True] * 68}


@given(
    st.sampled_from(sorted(SCHEME_SIZES)).flatmap(
        lambda scheme: st.tuples(
            st.just(scheme),
            arrays(
                np.float64,
                (SCHEME_SIZES[scheme], 2),
                elements=st.floats(-1e6, 1e6),
                fill=st.just(1.5),
            ),
            st.integers(6, SCHEME_SIZES[scheme]),
        )
    )
)
def test_json_round_trip(case: tuple[str, np.ndarray, int]):
    scheme, points, seen = case
    original = Landmarks(scheme, points, np.arange(len(points)) < seen)
    loaded = Landmarks.from_json(json.loads(json.dumps(original.to_json())))
    assert loaded.scheme == scheme
    np.testing.assert_array_equal(loaded.points, points)
    np.testing.assert_array_equal(loaded.visible, original.visible)


def test_reads_a_file_without_visibility_as_all_visible(tmp_path: Path):
    path = tmp_path / "points.json"
    path.write_text(json.dumps({"scheme": "ibug68", "points": POINTS}))
    landmarks = Landmarks.read(path)
    assert landmarks.visible.all()
    np.testing.assert_allclose(landmarks.points, POINTS)


def test_a_hidden_point_may_be_unknown():
    points = [[float("nan")] * 2, *POINTS[1:]]
    landmarks = Landmarks.from_json(GOOD | {"points": points, "visible": [False, *[True] * 67]})
    assert not landmarks.visible[0] and np.isnan(landmarks.points[0]).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"scheme": "dlib5"}, ["scheme", "dlib5", "ibug68"]),
        ({"scheme": None}, ["scheme", "null", "ibug68"]),
        ({"scheme": ["ibug68"]}, ["scheme", "ibug68"]),
        ({"points": POINTS[:67]}, ["points has shape (67, 2)", "(68, 2)"]),
        ({"points": [[1, 2, 3]] * 68}, ["[x, y]"]),
        ({"points": [1.0] * 68}, ["[x, y]"]),
        ({"points": 5}, ["[x, y]"]),
        ({"points": "left eye"}, ["[x, y]"]),
        ({"points": [["a", "b"]] * 68}, ["points[0][0] is 'a'", "numbers"]),
        ({"points": [[1, 2]] * 67 + [[1]]}, ["[x, y]"]),
        ({"points": [[float("nan"), 1.0], *POINTS[1:]]}, ["NaN", "visible"]),
        ({"points": [[float("inf"), 1.0], *POINTS[1:]]}, ["infinity", "visible"]),
        ({"visible": [True] * 67}, ["visible has shape (67,)", "(68,)"]),
        ({"visible": [True] * 5 + [False] * 63}, ["5 points visible", "6"]),
        ({"weights": [1.0] * 67}, ["weights has shape (67,)", "(68,)"]),
        ({"weights": 2.0}, ["weights is 2.0", "for each point"]),
        ({"weights": [1.0] * 67 + [-0.5]}, ["weights holds -0.5", "0 to"]),
        ({"weights": [float("nan"), *[1.0] * 67]}, ["weights holds NaN"]),
        ({"weights": [float("inf"), *[1.0] * 67]}, ["weights holds NaN or infinity"]),
        ({"weights": ["much"] * 68}, ["weights[0] is 'much'", "numbers"]),
        ({"weights": [1.0] * 5 + [0.0] * 63}, ["5 points visible", "6"]),
    ],
)
def test_wrong_values_are_named(change: dict, words: list[str]):
    with pytest.raises(InputError) as caught:
        Landmarks.from_json(GOOD | change, "landmark file 'points.json'")
    for word in ["points.json", *words]:
        assert word in str(caught.value)


def test_weights_come_back_and_a_point_without_weight_may_be_unknown():
    points = [[float("nan")] * 2, *POINTS[1:]]
    landmarks = Landmarks.from_json(GOOD | {"points": points, "weights": [0, 2.5, *[1] * 66]})
    assert landmarks.counted.sum() == 67 and not landmarks.counted[0]
    again = Landmarks.from_json(landmarks.to_json())
    assert again.weights is not None and again.weights[:3].tolist() == [0, 2.5, 1]
    plain = Landmarks.from_json(GOOD)
    assert plain.weights is None and plain.counted.all() and "weights" not in plain.to_json()


def test_missing_points_are_named():
    with pytest.raises(InputError, match="lacks points, expected \\[x, y\\]"):
        Landmarks.from_json({"scheme": "ibug68"})


def test_points_on_the_photo_pass_even_when_the_frame_cuts_the_face():
    points = np.array(POINTS)
    points[:10] -= [45, 0]
    Landmarks("ibug68", points, np.ones(68, bool)).check_inside(100, 100)


@pytest.mark.parametrize(
    ("points", "words"),
    [
        (np.array(POINTS) * 8, ["outside", "100 x 100", "this size"]),
        (np.array(POINTS) - 1000, ["outside", "100 x 100"]),
        (np.full((68, 2), 50.0), ["less than 4 pixels"]),
    ],
)
def test_points_off_the_photo_are_refused(points: np.ndarray, words: list[str]):
    with pytest.raises(InputError) as caught:
        Landmarks("ibug68", points, np.ones(68, bool)).check_inside(100, 100)
    for word in words:
        assert word in str(caught.value)


def test_hidden_points_off_the_photo_do_not_matter():
    points = np.array(POINTS)
    points[3] = 1e6
    visible = np.arange(68) != 3
    Landmarks("ibug68", points, visible).check_inside(100, 100)
