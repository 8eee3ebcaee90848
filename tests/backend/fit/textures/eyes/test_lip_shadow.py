"""The lips' shadow on teeth: what pixels say of it, spread over the vertices about them."""

import numpy as np
import pytest

from facestage.fit.textures.eyes.lip_shadow import COUNT, POINTS_MAX, REACH, out_of_shadow


def test_many_points_are_believed_and_far_vertices_stay():
    points = np.random.default_rng(0).normal(0, 0.2 * REACH, (500, 3))
    near, far = np.zeros((1, 3)), np.full((1, 3), 20 * REACH)
    found = out_of_shadow(np.concatenate([near, far]), points, np.full(500, 0.4))
    np.testing.assert_allclose(found, [0.4, 0.0], atol=0.01)


def test_as_many_points_as_the_prior_say_half():
    points = np.zeros((int(COUNT), 3))
    assert out_of_shadow(points[:1], points, np.full(len(points), 0.4)) == pytest.approx(0.2)


def test_more_points_than_are_asked_say_the_same():
    points = np.random.default_rng(1).normal(0, REACH, (4 * POINTS_MAX, 3))
    lighter = np.where(points[:, 0] > 0, 0.3, -0.3)
    found = out_of_shadow(np.array([[2 * REACH, 0, 0], [-2 * REACH, 0, 0]]), points, lighter)
    np.testing.assert_allclose(found, [0.24, -0.24], atol=0.04)
