"""Handles have names; what lies between them follows smoothly."""

from __future__ import annotations

import numpy as np


def test_handles_are_named_and_distinct() -> None:
    from facestage_blender.landmarks.scheme import IBUG_NAMES, handles, lines

    assert handles("ibug68", 68)[30].name == "Landmark 31 nose tip"
    assert len({handle.index for handle in handles("mediapipe478", 478)}) == len(IBUG_NAMES) + 5
    assert len(handles("another", 12)) == 12
    for scheme, count in (("ibug68", 68), ("mediapipe478", 478)):
        assert {index for line in lines(scheme) for index in line} <= {
            item.index for item in handles(scheme, count)
        }


def test_followers_move_smoothly() -> None:
    """One dragged handle takes its surroundings along and leaves the rest."""
    from facestage_blender.landmarks.scheme import follow

    rng = np.random.default_rng(0)
    axis = np.linspace(0, 100, 9)
    knots = np.stack(np.meshgrid(axis, axis), -1).reshape(-1, 2)
    near, far = rng.uniform(-3, 3, (50, 2)) + 50, rng.uniform(0, 20, (50, 2))
    points = np.concatenate([knots, near, far])
    centre = 40
    moved = knots.copy()
    moved[centre] += [4, -2]
    after = follow(points, np.arange(81), moved) - points
    np.testing.assert_array_equal(after[:81], moved - knots)
    assert np.abs(after[81:131] - [4, -2]).max() < 1.5
    assert np.abs(after[131:]).max() < 0.1
    # Handles on one point, as those of closed lids, and handles that cannot determine a plane.
    np.testing.assert_allclose(
        follow(
            np.array([[0.0, 0], [0, 0], [9, 0], [4, 5]]),
            np.arange(3),
            np.array([[1.0, 0], [1, 0], [10, 0]]),
        )[3],
        [5, 5],
        atol=1e-2,
    )
