"""The light stage: the Fibonacci lattice for any N, rigid transforms, and lights that are off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from facestage.contract.errors import InputError
from facestage.contract.light_stage import (
    BEHIND_COUNT_MAX,
    BEHIND_FINER,
    BEHIND_MOST,
    FROZEN,
    GOLDEN_ANGLE,
    LIGHT_ARRAYS,
    OFF,
    ON,
    LightStage,
    StageSchema,
    fibonacci_stage,
    joined,
    lights_behind,
    selected,
)
from facestage.contract.schemas.schema import checked
from reference.known import known

counts = st.integers(1, 300)


@given(counts, st.floats(0.1, 5.0), st.floats(0.01, 1.0))
def test_lights_face_the_centre_from_the_front_hemisphere(count: int, radius: float, side: float):
    stage = fibonacci_stage(count, radius, side)
    assert len(stage) == count
    np.testing.assert_allclose(np.linalg.norm(stage.position, axis=1), radius)
    np.testing.assert_allclose(stage.direction, -stage.position / radius, atol=1e-12)
    assert (stage.position[:, 2] > 0).all(), "the pole is +Z"
    for axis in (stage.axis_x, stage.axis_y):
        np.testing.assert_allclose(np.linalg.norm(axis, axis=1), 1)
        np.testing.assert_allclose((axis * stage.direction).sum(1), 0, atol=1e-12)
    np.testing.assert_allclose((stage.axis_x * stage.axis_y).sum(1), 0, atol=1e-12)
    np.testing.assert_allclose(
        np.cross(stage.axis_x, stage.axis_y), -np.cross(stage.axis_y, stage.axis_x)
    )
    np.testing.assert_allclose(np.cross(stage.direction, stage.axis_x), stage.axis_y)


@given(counts, st.integers(1, 8))
def test_every_band_of_height_holds_its_share_of_lights(count: int, bands: int):
    # Archimedes: equal bands of height cover equal solid angles.
    height = fibonacci_stage(count).position[:, 2]
    held = np.histogram(height, np.linspace(0, 1, bands + 1))[0]
    assert np.abs(held - count / bands).max() <= 1


@pytest.mark.parametrize("count", [20, 100])
def test_each_light_covers_an_even_solid_angle(count: int):
    # Share of a fine uniform set of directions that is nearest to each light; the rim's cells are
    # cut.
    stage, fine = fibonacci_stage(count), fibonacci_stage(10000)
    nearest = cKDTree(stage.position).query(fine.position)[1]
    share = np.bincount(nearest, minlength=count) * count / 10000
    inner = stage.position[:, 2] > 1.5 / np.sqrt(count)
    print(
        f"solid angle over its even share, N={count}: {share[inner].min():.2f} to "
        f"{share[inner].max():.2f}"
    )
    assert share[inner].min() > 0.75 and share[inner].max() < 1.3


@given(counts)
def test_both_halves_are_one_lattice_of_the_sphere(count: int):
    front, behind = fibonacci_stage(count), fibonacci_stage(count, behind=True)
    whole = joined(front, behind)
    assert len(whole) == 2 * count and (behind.position[:, 2] < 0).all()
    np.testing.assert_allclose(-np.diff(whole.position[:, 2]), 1 / count)
    turn = np.angle(whole.position[:, 0] + 1j * whole.position[:, 1])
    step = np.angle(np.exp(1j * (np.diff(turn) - GOLDEN_ANGLE)))
    np.testing.assert_allclose(step, 0, atol=1e-6)
    np.testing.assert_allclose(behind.direction, -behind.position, atol=1e-12)


@given(counts, st.floats(0.1, 5.0), st.floats(0.01, 1.0))
def test_lights_behind_are_dark_fitted_and_not_where_the_head_hides_them(
    count: int, radius: float, side: float
):
    behind = known(lights_behind(fibonacci_stage(count, radius, side)))
    np.testing.assert_allclose(np.linalg.norm(behind.position, axis=1), radius)
    assert (behind.side == side).all() and (behind.state == ON).all()
    assert not behind.radiance.any()
    height = behind.position[:, 2] / radius
    assert (height < 0).all() and (height > -BEHIND_MOST).all()
    assert len(behind) >= 0.8 * min(BEHIND_FINER * count, BEHIND_COUNT_MAX)


def test_a_stage_with_a_light_behind_needs_none():
    front = fibonacci_stage(5)
    one = selected(fibonacci_stage(5, behind=True), np.array([2]))
    assert lights_behind(joined(front, one)) is None


def test_the_lattice_is_deterministic_and_its_pole_is_z():
    first, second = fibonacci_stage(21), fibonacci_stage(21)
    np.testing.assert_array_equal(first.position, second.position)
    np.testing.assert_allclose(fibonacci_stage(20).position.mean(0)[2], 0.5)
    assert fibonacci_stage(1).position[0, 2] == pytest.approx(0.5)


def test_the_mean_direction_has_no_side():
    mean = fibonacci_stage(200).position.mean(0)
    assert np.abs(mean[:2]).max() < 0.02


@given(counts, st.integers(0, 1000))
def test_a_rigid_transform_moves_every_point_of_every_light(count: int, seed: int):
    stage = fibonacci_stage(count)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.random(random_state=seed).as_matrix()
    matrix[:3, 3] = [0.3, -0.2, 5.0]
    moved = stage.transformed(matrix)
    np.testing.assert_allclose(
        moved.corners, stage.corners @ matrix[:3, :3].T + matrix[:3, 3], atol=1e-12
    )
    np.testing.assert_allclose(moved.direction, stage.direction @ matrix[:3, :3].T, atol=1e-12)
    back = moved.transformed(np.linalg.inv(matrix))
    for name in ("position", "direction", "axis_x"):
        np.testing.assert_allclose(getattr(back, name), getattr(stage, name), atol=1e-12)
    for name in ("side", "radiance", "state"):
        np.testing.assert_array_equal(getattr(moved, name), getattr(stage, name))


def test_corners_form_the_square():
    stage = fibonacci_stage(7, side=0.3)
    corners = stage.corners
    np.testing.assert_allclose(corners.mean(1), stage.position)
    edges = np.linalg.norm(np.diff(np.concatenate([corners, corners[:, :1]], 1), axis=1), axis=2)
    np.testing.assert_allclose(edges, 0.3)
    np.testing.assert_allclose(
        np.linalg.norm(corners[:, 0] - corners[:, 2], axis=1), 0.3 * np.sqrt(2)
    )


def test_off_lights_stay_exactly_zero():
    stage = replace(fibonacci_stage(3), state=np.array([ON, OFF, FROZEN]))
    lit = stage.with_radiance(np.full((3, 3), 7.0))
    np.testing.assert_array_equal(lit.radiance, [[7, 7, 7], [0, 0, 0], [7, 7, 7]])


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"radiance": np.full((2, 3), -1.0)}, "negative radiance.*0 or more"),
        ({"radiance": np.full((2, 3), np.nan)}, "radiance holds NaN"),
        ({"radiance": np.ones((3, 3))}, r"radiance has shape \(3, 3\), expected \(2, 3\)"),
        ({"position": np.full((2, 3), np.inf)}, "position holds NaN or infinity"),
        ({"direction": np.ones((2, 2))}, r"direction has shape \(2, 2\), expected \(2, 3\)"),
        ({"side": np.array([0.2, 0.0])}, "side must be greater than 0"),
        ({"state": np.zeros(3, int)}, r"state has shape \(3,\), expected \(2,\)"),
    ],
)
def test_wrong_arrays_are_named(change: dict, words: str):
    with pytest.raises(InputError, match=words):
        replace(fibonacci_stage(2), **change)


def test_an_empty_stage_is_refused():
    empty = {
        "position": (0, 3),
        "direction": (0, 3),
        "axis_x": (0, 3),
        "side": (0,),
        "radiance": (0, 3),
        "state": (0,),
    }
    with pytest.raises(InputError, match="no light"):
        replace(fibonacci_stage(2), **{name: np.zeros(shape) for name, shape in empty.items()})


@pytest.mark.parametrize("count", [0, -1, 10001])
def test_wrong_counts_are_named(count: int):
    with pytest.raises(InputError, match=rf"asked for {count} lights; expected 1 to 10000"):
        fibonacci_stage(count)


@pytest.mark.parametrize("size", [{"radius": 0.0}, {"side": -1.0}, {"radius": float("nan")}])
def test_wrong_sizes_are_named(size: dict):
    with pytest.raises(InputError, match=r"radius .* side .* greater than 0"):
        fibonacci_stage(3, **size)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"direction": np.zeros((2, 3))}, "direction holds directions that are not of length 1"),
        (
            {"axis_x": fibonacci_stage(2).direction},
            "axis_x holds axes that are not at right angles",
        ),
        ({"side": np.full(2, 1e-9)}, "side holds 1e-09, expected numbers of 1e-06 to"),
        ({"radiance": np.full((2, 3), 1e30)}, "radiance holds 1e\\+30"),
        ({"state": np.array([0, 3])}, "state holds 3, expected whole numbers of 0 to 2"),
        ({"state": np.zeros(2)}, "state holds float64 values, expected whole numbers"),
        ({"position": np.full((2, 3), 1e12)}, "position holds 1e\\+12"),
    ],
)
def test_a_stage_in_a_file_is_checked_further(change: dict, words: str):
    sound = {name: getattr(fibonacci_stage(2), name) for name in LIGHT_ARRAYS}
    assert len(LightStage(**checked(StageSchema(), sound, "The file"))) == 2
    with pytest.raises(InputError, match=words):
        checked(StageSchema(), sound | change, "The file")
