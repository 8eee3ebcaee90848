"""Meshes that were modelled with a mirror are told from others."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.models.mesh.mirror import mirrored_axis


def half(count: int = 200) -> np.ndarray:
    """(n, 3) points on one side of a plane, without any order of their own."""
    return np.random.default_rng(3).uniform(0.1, 1.0, (count, 3))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_axis_of_a_mirror_is_found_wherever_the_mesh_is(axis: int) -> None:
    other = half()
    other[:, axis] *= -1
    whole = 50.0 * np.concatenate([half(), other]) + [3.0, -20.0, 150.0]
    assert mirrored_axis(whole) == axis
    whole[: len(whole) // 10] += 0.5  # centimetres, as of a sculpted side
    assert mirrored_axis(whole) is None


def test_a_box_of_points_has_none_of_its_own() -> None:
    assert mirrored_axis(half()) is None
    sides = np.array(np.meshgrid([-1, 1], [-2, 2], [-3, 3])).reshape(3, -1).T
    assert mirrored_axis(sides.astype(np.float64)) is None
