"""Lights that turn about the stage's centre, and which of them are worth it."""

from __future__ import annotations

import numpy as np

from facestage.contract.light_stage import OFF, fibonacci_stage, joined
from facestage.fit.face.lamps import STRONG_MAX, spacing, strong_lights, turned


def test_a_turned_light_keeps_its_distance_and_faces_the_centre():
    pivot = np.array([0.1, -0.2, -0.9])
    matrix = np.eye(4)
    matrix[:3, 3] = pivot
    stage = fibonacci_stage(7).transformed(matrix)
    angles = np.random.default_rng(1).uniform(-0.4, 0.4, (7, 2))
    moved = turned(stage, angles, pivot)
    np.testing.assert_allclose(np.linalg.norm(moved.position - pivot, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(moved.direction, pivot - moved.position, atol=1e-12)
    cosine = ((stage.position - pivot) * (moved.position - pivot)).sum(axis=1)
    np.testing.assert_allclose(np.arccos(cosine), np.linalg.norm(angles, axis=1), atol=1e-7)
    np.testing.assert_allclose((moved.axis_x * moved.direction).sum(axis=1), 0.0, atol=1e-12)


def test_the_first_angle_is_sideways_and_the_second_up():
    stage = fibonacci_stage(9)
    for axis, along in ((0, stage.axis_x), (1, stage.axis_y)):
        angles = np.zeros((9, 2))
        angles[:, axis] = 1e-4
        shift = turned(stage, angles, np.zeros(3)).position - stage.position
        cosine = (shift * along).sum(axis=1) / np.linalg.norm(shift, axis=1)
        np.testing.assert_allclose(np.abs(cosine), 1.0, atol=1e-6)


def test_no_angle_is_the_same_stage():
    stage = fibonacci_stage(5)
    assert turned(stage, np.zeros((5, 2)), np.zeros(3)) is stage


def test_strong_lights_are_few_fitted_and_bright():
    stage = fibonacci_stage(10)
    level = np.array([50, 40, 30, 20, 12, 1, 1, 1, 0, 0.0])
    fitted = np.ones(10, bool)
    fitted[1] = False
    strong = strong_lights(stage, level[:, None] * np.ones(3), fitted)
    assert strong[0] and not strong[1] and not strong[5:].any()
    assert strong.sum() <= STRONG_MAX


def test_behind_the_face_a_light_counts_by_its_share_of_the_rims():
    stage = joined(fibonacci_stage(6), fibonacci_stage(6, behind=True))
    level = np.array([60, 30, 1, 1, 1, 1, 4, 3, 0.2, 0, 0, 0.0])
    fitted = np.ones(12, bool)
    strong = strong_lights(stage, level[:, None] * np.ones(3), fitted)
    np.testing.assert_array_equal(np.flatnonzero(strong), [0, 1, 6, 7])
    # A rim of next to nothing is none.
    level[6:] *= 0.1
    strong = strong_lights(stage, level[:, None] * np.ones(3), fitted)
    np.testing.assert_array_equal(np.flatnonzero(strong), [0, 1])


def test_no_light_is_strong_in_the_dark_or_when_all_are_held():
    stage = fibonacci_stage(3)
    assert not strong_lights(stage, np.zeros((3, 3)), np.ones(3, bool)).any()
    assert not strong_lights(stage, np.ones((3, 3)), np.zeros(3, bool)).any()
    assert (stage.state != OFF).all()


def test_spacing_of_the_lattice():
    """The mean angle to the nearest neighbour, within a quarter; one light may go anywhere it is
    seen from.
    """
    for count in (20, 100):
        outward = -fibonacci_stage(count).direction
        angle = np.arccos(np.clip(outward @ outward.T, -1, 1)) + 10 * np.eye(count)
        np.testing.assert_allclose(spacing(count), angle.min(axis=1).mean(), rtol=0.25)
    assert spacing(1) == np.pi / 2
