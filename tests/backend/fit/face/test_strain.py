"""How skin is pressed: known stretches of a plane, turned any way."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.fit.face.strain import SkinPlanes

TRIANGLES = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2]])
POINTS = np.array(
    [[0.0, 0, 0], [0.01, 0, 0], [0.003, 0.008, 0], [0.012, 0.009, 0], [0.004, 0.02, 0]]
)


@pytest.mark.parametrize("seed", range(4))
def test_what_is_lost_and_which_way_is_that_of_the_stretch(seed: int):
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, np.pi)
    way, along = np.array([np.cos(angle), np.sin(angle), 0]), np.array([0, 0, 1.0])
    other = np.cross(along, way)
    stretch = 0.75 * np.outer(way, way) + 1.1 * np.outer(other, other)
    turns = Rotation.random(2, random_state=seed).as_matrix()
    planes = SkinPlanes.of(POINTS @ turns[0].T, TRIANGLES)
    lost, direction = planes.pressed(POINTS @ stretch.T @ turns[1].T + rng.normal(size=3))
    np.testing.assert_allclose(lost, 0.25, atol=1e-9)
    there = np.einsum("tax,ta->tx", planes.axes, direction)
    np.testing.assert_allclose(np.abs(there @ turns[0] @ way), 1.0, atol=1e-9)


def test_what_only_grows_or_turns_loses_nothing():
    planes = SkinPlanes.of(POINTS, TRIANGLES)
    turn = Rotation.from_euler("xyz", [0.3, -1.0, 2.0]).as_matrix()
    np.testing.assert_allclose(planes.pressed(POINTS @ turn.T)[0], 0.0, atol=1e-12)
    np.testing.assert_allclose(planes.pressed(1.2 * POINTS)[0], -0.2, atol=1e-12)


def test_gradients_are_those_of_linear_values_and_of_no_triangle_without_area():
    slope = np.array([[3.0, -1.0, 2.0], [0.5, 0.0, 1.0]])
    triangles = np.array([*TRIANGLES, [0, 1, 1]])
    planes = SkinPlanes.of(POINTS, triangles)
    found = planes.gradient(POINTS @ slope.T)
    wanted = np.einsum("dx,tax->tda", slope, planes.axes[:3])
    np.testing.assert_allclose(found[:3], wanted, atol=1e-12)
    assert not found[3].any() and planes.pressed(POINTS)[0][3] == 0
