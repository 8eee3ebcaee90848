"""Numbers that both sides of the contract share, against what they stand for."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from facestage.contract import brdf
from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.events import Event
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import LightStage, fibonacci_stage, horizontal_axis
from facestage.contract.quality import QUALITIES, Expectation, describe, expectations, parse_budget

INDEX = 1.5


def fresnel(cosine: float) -> float:
    """Unpolarised reflectance of a dielectric of INDEX."""
    inside = np.sqrt(1 - (1 - cosine**2) / INDEX**2)
    across = (cosine - INDEX * inside) / (cosine + INDEX * inside)
    parallel = (INDEX * cosine - inside) / (INDEX * cosine + inside)
    return float(0.5 * (across**2 + parallel**2))


def test_reflectance_is_that_of_a_dielectric_of_index_1_5():
    assert pytest.approx(fresnel(1.0)) == brdf.F0
    reflected = quad(lambda cosine: 2 * cosine * fresnel(cosine), 0, 1)[0]
    assert pytest.approx(1 - reflected, abs=5e-4) == brdf.K_DIFFUSE
    assert brdf.K_SPECULAR == 1.0


def test_bounds_of_the_skin_are_those_that_written_results_keep_to():
    """A result of any version lies within them, and Blender's material is made for them."""
    assert (brdf.ROUGHNESS_MIN, brdf.ROUGHNESS_MAX, brdf.SPECULAR_MAX, brdf.ALBEDO_MAX) == (
        0.05,
        1.0,
        2.0,
        0.999,
    )


def test_a_camera_has_at_most_16384_pixels_along_a_side_134_million_in_all_and_at_least_one():
    assert Camera(16384, 8192, 1.0, (0.0, 0.0)).scaled(1e-9).width == 1
    for width, height in ((16385, 1), (1, 16385), (0, 1), (1, 0)):
        with pytest.raises(InputError, match="1 to 16384"):
            Camera(width, height, 1.0, (0.0, 0.0))
    with pytest.raises(InputError, match="134"):
        Camera(16384, 8193, 1.0, (0.0, 0.0))


def test_an_event_says_nothing_that_it_was_not_told():
    assert vars(Event("progress")) == {
        "kind": "progress",
        "stage": "",
        "iteration": 0,
        "error": None,
        "seconds": 0.0,
        "seconds_left": None,
        "fraction": 0.0,
        "preview": None,
        "message": "",
    }


def face(**changes: np.ndarray) -> Landmarks:
    points = np.random.default_rng(0).uniform(20, 80, (68, 2))
    return Landmarks(
        "ibug68", changes.get("points", points), np.ones(68, bool), changes.get("weights")
    )


@pytest.mark.parametrize("ratio", [0.03, 0.05])
def test_landmarks_narrower_than_a_twenty_fifth_are_a_line(ratio: float):
    turn = np.linspace(0, 2 * np.pi, 68, endpoint=False)
    # Around a middle that is not the origin: the spread is about the mean.
    flat = Landmarks(
        "ibug68", 50 + 40 * np.stack([np.cos(turn), ratio * np.sin(turn)], 1), np.ones(68, bool)
    )
    if ratio > 0.04:
        flat.check_inside(100, 100)
        return
    with pytest.raises(InputError, match="on one line"):
        flat.check_inside(100, 100)


@pytest.mark.parametrize(
    ("place", "inside"),
    [
        ([149, 50], True),
        ([151, 50], False),
        ([50, 149], True),
        ([50, 151], False),
        ([-49, 50], True),
        ([-51, 50], False),
        ([50, -49], True),
        ([50, -51], False),
    ],
)
def test_a_landmark_may_lie_half_a_picture_outside(place: list[float], inside: bool):
    points = face().points.copy()
    points[7] = place
    if inside:
        face(points=points).check_inside(100, 100)
        return
    with pytest.raises(InputError, match="1 landmarks lie far outside"):
        face(points=points).check_inside(100, 100)


def test_the_median_may_lie_on_the_border():
    points = face().points - np.median(face().points, axis=0) + 1e-9
    face(points=points).check_inside(100, 100)
    for shift in ([0.5, 0.0], [0.0, 0.5]):
        with pytest.raises(InputError, match="far outside"):
            face(points=points - shift).check_inside(100, 100)
        with pytest.raises(InputError, match="far outside"):
            face(points=points + 100.0 + np.array(shift)).check_inside(100, 100)


@pytest.mark.parametrize(("size", "enough"), [(3.9, False), (4.1, True)])
def test_a_face_spans_four_pixels_wherever_it_lies(size: float, enough: bool):
    points = face().points
    points = [60, 10] + size * (points - points.min(axis=0)) / np.ptp(points, axis=0)
    if enough:
        face(points=points).check_inside(100, 100)
        return
    with pytest.raises(InputError, match="less than 4 pixels"):
        face(points=points).check_inside(100, 100)


def test_a_weight_of_zero_is_a_weight():
    data = face().to_json() | {"weights": [0.0] + [1.0] * 67}
    weights = Landmarks.from_json(data).weights
    assert weights is not None and weights[0] == 0 and weights[1:].min() == 1


def test_corners_go_around_the_square():
    stage = LightStage(
        np.array([[1.0, 2, 3]]),
        np.array([[0.0, 0, -1]]),
        np.array([[1.0, 0, 0]]),
        np.array([0.5]),
        np.ones((1, 3)),
        np.zeros(1, int),
    )
    wanted = [[0.75, 2.25, 3], [1.25, 2.25, 3], [1.25, 1.75, 3], [0.75, 1.75, 3]]
    np.testing.assert_allclose(stage.corners[0], wanted)


def test_the_lattice_has_level_sides_and_light_of_one():
    stage = fibonacci_stage(50)
    np.testing.assert_array_equal(stage.radiance, 1.0)
    np.testing.assert_allclose(stage.axis_x[:, 1], 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(stage.axis_x, axis=1), 1)
    np.testing.assert_allclose((stage.axis_x * stage.direction).sum(1), 0, atol=1e-12)


def test_straight_above_and_below_a_side_is_level_too():
    found = horizontal_axis(np.array([[0.0, 1, 0], [0, -1, 0], [0.6, 0.8, 0]]))
    np.testing.assert_allclose(found, [[-1, 0, 0], [1, 0, 0], [0, 0, -1]], atol=1e-12)


def test_every_quality_was_measured_and_says_so(tmp_path: Path):
    found = expectations()
    assert set(found) == set(QUALITIES)
    for name, expected in found.items():
        assert isinstance(expected, Expectation) and expected.sentence() in describe(name)
    assert expectations(tmp_path / "none.json") == {}
    (tmp_path / "one.json").write_text(
        '{"qualities": {"good": {"seconds": 1, "similarity_mm": 2, "psnr": 3}}}'
    )
    assert expectations(tmp_path / "one.json") == {"good": Expectation(1, 2, 3)}


def test_half_a_second_is_a_budget():
    assert parse_budget("0.5") == (0.5, "good")
