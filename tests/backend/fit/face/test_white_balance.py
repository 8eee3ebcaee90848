"""What something grey in the photo says of the light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.face.light_axes import color_of
from facestage.fit.face.light_color import COMMON_SIGMA, LightPrior
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.white_balance import GREY_SIGMA, WhiteBalance

CAMERA = np.array([0.0, 0.0, 1.0])
SIDES = np.array([[-1.0, 0.0, 1.0], [1.0, 0.0, 1.0]]) / np.sqrt(2)
WARM, COOL = np.array([1.5, 1.0, 0.5]), np.array([0.6, 0.95, 1.45])


def balance(grey: np.ndarray, radiance: np.ndarray, towards: np.ndarray = SIDES) -> WhiteBalance:
    return WhiteBalance.of(grey, towards, np.ones(len(towards)), radiance, CAMERA)


def test_under_lights_of_one_color_grey_has_that_color():
    found = balance(3 * WARM, np.array([0.1, 7.0])[:, None] * WARM)
    np.testing.assert_allclose(found.color, color_of(WARM), atol=1e-12)
    np.testing.assert_allclose(found.sigma, GREY_SIGMA, rtol=1e-6)
    np.testing.assert_allclose(found.shares, 1, atol=0.02)


def test_between_two_colors_nobody_says_which_way_grey_faces():
    """Along the locus, on which both lie; not towards green."""
    one, two = color_of(WARM), color_of(COOL)
    found = balance(np.ones(3), np.stack([WARM, COOL]))
    assert 0.2 < found.sigma[0] / abs(one[0] - two[0]) < 0.5
    assert found.sigma[1] < 2 * GREY_SIGMA[1]
    close = balance(np.ones(3), np.stack([WARM, COOL]), SIDES[[0, 0]])
    np.testing.assert_allclose(close.sigma, GREY_SIGMA, rtol=1e-6)


def test_grey_that_the_camera_sees_hardly_sees_a_light_behind_it():
    behind = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]])
    shares = balance(np.ones(3), np.ones((2, 3)), behind).shares
    assert shares.sum() == pytest.approx(2) and shares[0] < 0.2 * shares[1]


def test_darkness_doubts_nothing():
    np.testing.assert_allclose(balance(np.ones(3), np.zeros((2, 3))).sigma, GREY_SIGMA)


@pytest.mark.parametrize("uniform", [False, True])
def test_the_slope_is_that_of_the_residuals(uniform: bool):
    random = np.random.default_rng(0)
    fitted = np.array([True, True, False, True])
    held = np.where(fitted[:, None], 0.0, [0.3, 0.9, 1.8])
    lights = LightParameters(fitted, held, uniform)
    values = lights.from_radiance(random.uniform(0.5, 5, (4, 3)))
    towards = np.abs(random.normal(size=(4, 3)))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    white = balance(WARM, lights.radiance(values), towards)
    prior = LightPrior(lights, 2.0, white=white).scaled(1.3)
    step = 1e-6
    sides = [
        (prior.residuals(values + step * unit) - prior.residuals(values - step * unit)) / (2 * step)
        for unit in np.eye(len(values))
    ]
    np.testing.assert_allclose(prior.jacobian(values), np.stack(sides, axis=1), atol=1e-7)


def test_it_stands_in_for_what_is_known_of_white_balances():
    """Green light costs nothing where grey is green, and light that is held counts."""
    green = np.array([0.7, 1.6, 0.7])
    lights = LightParameters(np.ones(3, bool), np.zeros((3, 3)), uniform=False)
    values = np.tile(green, 3)
    white = WhiteBalance(color_of(green), GREY_SIGMA, np.ones(3))
    without, known = LightPrior(lights, 1.0), LightPrior(lights, 1.0, white=white)
    cost, free = (float((one.residuals(values) ** 2).sum()) for one in (without, known))
    assert cost - free > 1
    np.testing.assert_allclose(known.residuals(values)[-2:], 0, atol=1e-12)
    assert len(without.residuals(values)) == len(known.residuals(values))
    wide = replace(white, sigma=COMMON_SIGMA)
    assert abs(LightPrior(lights, 1.0, white=wide).residuals(np.ones(9))[-1]) > 1

    half = LightParameters(np.array([True, False]), np.array([[0, 0, 0], COOL]), uniform=False)
    mixed = WhiteBalance(color_of(WARM + COOL), GREY_SIGMA, np.ones(2))
    np.testing.assert_allclose(
        LightPrior(half, 1.0, white=mixed).residuals(WARM)[-2:], 0, atol=1e-12
    )
