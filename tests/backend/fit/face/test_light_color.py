"""What is known of light: colors of lamps and skies, whatever the exposure."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.arrays import Float
from facestage.fit.face.light_axes import AXES
from facestage.fit.face.light_color import (
    COMMON_SIGMA,
    LEAST,
    LEVEL_SIGMA,
    LIGHT_COST,
    OWN_SIGMA,
    SHARE_SIGMA,
    SHINING,
    LightPrior,
)
from facestage.fit.face.light_parameters import LightParameters
from reference.normal_equations import normal_equations

# Linear Rec. 709 of mean 1: black bodies of 2800, 3500 and 4500 K, daylight of 5500, 9500, 15000 K.
ILLUMINANTS = np.array(
    [
        [1.921, 0.854, 0.225],
        [1.631, 0.943, 0.425],
        [1.341, 0.983, 0.676],
        [1.137, 1.017, 0.847],
        [0.784, 0.945, 1.271],
        [0.642, 0.885, 1.473],
    ]
)


def prior_of(count: int, scale: float = 1.0, uniform: bool = False) -> LightPrior:
    return LightPrior(LightParameters(np.ones(count, bool), np.zeros((count, 3)), uniform), scale)


def cost(light: Float[np.ndarray, "lights 3"], scale: float | None = None) -> float:
    prior = prior_of(len(light), float(light.mean()) if scale is None else scale)
    return 0.5 * float((prior.residuals(light.ravel()) ** 2).sum())


@pytest.mark.parametrize("uniform", [False, True])
def test_the_slope_is_that_of_the_residuals(uniform: bool):
    random = np.random.default_rng(0)
    fitted = np.array([True, True, False, True, True])
    lights = LightParameters(fitted, np.zeros((5, 3)), uniform)
    values = lights.from_radiance(random.uniform(0, 5, (5, 3)))
    if not uniform:
        values[:3] *= -1  # as a harmonic's may be
    prior = LightPrior(lights, 2.0).scaled(1.3)
    jacobian, step = prior.jacobian(values), 1e-6
    sides = [
        (prior.residuals(values + step * unit) - prior.residuals(values - step * unit)) / (2 * step)
        for unit in np.eye(len(values))
    ]
    np.testing.assert_allclose(jacobian, np.stack(sides, axis=1), atol=1e-7)
    hessian, gradient = normal_equations(prior, values)
    curved = jacobian[~prior.concave(values)]
    np.testing.assert_allclose(hessian, curved.T @ curved)
    np.testing.assert_allclose(gradient, jacobian.T @ prior.residuals(values))
    assert np.linalg.matrix_rank(hessian) == len(values), "every light has a deviation"


def test_what_lights_cost_holds_none_of_them_in_the_dark():
    """A light that is out costs at most what it would if it shone, however stiff its slope."""
    prior = prior_of(4)
    values = np.array([[2.0] * 3, [1.0] * 3, [1.0] * 3, [0.0] * 3]).ravel()
    concave = prior.concave(values)
    cost, slope = prior.residuals(values)[concave], prior.jacobian(values)[concave]
    assert (cost[:3] > cost[3]).all() and cost[3] > 0
    hessian = normal_equations(prior, values)[0]
    brighter = np.repeat([0.0, 1.0], [9, 3])
    assert brighter @ hessian @ brighter < 0.1 * ((slope @ brighter) ** 2).sum()


def test_white_light_as_bright_as_guessed_costs_its_evenness_alone():
    found = prior_of(4, 2.0).residuals(np.full(12, 2.0))
    np.testing.assert_allclose(found[:10], 0, atol=1e-12)
    np.testing.assert_allclose(found[10:14], 1 / SHARE_SIGMA)
    shining = 2 * LIGHT_COST * np.log1p((0.25 + LEAST) / SHINING)
    np.testing.assert_allclose(found[14:18] ** 2, shining)
    np.testing.assert_allclose(found[18:], 0)


def test_exposure_is_nobody_s_prior():
    """Light of twice the radiance costs what the wide prior on the level says, no more."""
    light = np.random.default_rng(1).uniform(0.5, 5, (6, 3))
    once, twice = (prior_of(6, float(light.mean())).residuals(k * light.ravel()) for k in (1, 2))
    np.testing.assert_allclose(once[:-1], twice[:-1], atol=1e-12)
    assert once[-1] == pytest.approx(0) and twice[-1] == pytest.approx(1 / LEVEL_SIGMA)


def test_few_lamps_cost_less_than_a_veil_of_many():
    """Per lamp, hardly by its share: a tenth of the light is nearly as dear as a half."""

    def shining(shares: list[float]) -> float:
        light = np.array(shares)[:, None] * np.ones(3)
        residuals = prior_of(len(shares)).residuals(light.ravel())
        return 0.5 * float((residuals[-1 - len(shares) : -1] ** 2).sum())

    lamp, veil = shining([1.0] + [0.0] * 9), shining([0.73] + [0.03] * 9)
    assert 9 * 0.8 < (veil - lamp) / LIGHT_COST < 9
    assert shining([0.5, 0.5] + [0.0] * 8) - lamp > 2 * LIGHT_COST
    assert shining([0.9, 0.1] + [0.0] * 8) == pytest.approx(
        shining([0.5, 0.5] + [0.0] * 8), abs=1.5 * LIGHT_COST
    )


@pytest.mark.parametrize("color", ILLUMINANTS)
def test_light_of_lamps_and_skies_costs_less_than_green(color: np.ndarray):
    """As far from white; the white balance missed it."""
    distance = np.linalg.norm(color - 1)
    green = 1 + distance * AXES[1]
    green, color = (np.tile(one, (5, 1)) for one in (green, color))
    assert cost(color) - cost(np.ones((5, 3))) < 0.6 * (cost(green) - cost(np.ones((5, 3))))


def test_the_tint_of_all_light_counts_once():
    def tinted(count: int) -> np.ndarray:
        residuals = prior_of(count).residuals(np.tile(ILLUMINANTS[2], count))
        np.testing.assert_allclose(residuals[: 2 * count], 0, atol=0.05)
        return residuals[2 * count : 2 * count + 2]

    along = (ILLUMINANTS[2] @ AXES[0]) / COMMON_SIGMA[0]
    one, many = tinted(1), tinted(40)
    np.testing.assert_allclose(one, many)
    assert 0.9 * along < one[0] < along, "a long tail"


def test_each_lamp_may_have_its_own_color():
    warm, cool = np.array([1.5, 1.0, 0.5]), np.array([0.6, 0.95, 1.45])
    green, magenta = 1 + 0.7 * AXES[1], 1 - 0.7 * AXES[1]
    white = cost(np.ones((2, 3)))
    mixed, discotheque = (
        cost(np.stack([warm, cool])) - white,
        cost(np.stack([green, magenta])) - white,
    )
    assert mixed < 2 * 0.5 * (0.75 / OWN_SIGMA[0]) ** 2 < 0.3 * discotheque
    assert discotheque < cost(5 * np.eye(3)) < 100, "not forbidden"


def test_a_violet_and_a_green_lamp_are_no_cheap_way_to_explain_dark_skin():
    """As a fit put them beside three lamps on a dark man; together they are about white."""
    main = [(0.35, 0.75, 1.3), (0.3, 0.86, 1.05), (0.2, 0.84, 1.09)]

    def lit(*others: tuple[float, float, float]) -> float:
        share, red, blue = np.array([*main, *others]).T
        color = np.stack([red, np.ones(len(red)), blue], axis=1)
        return cost(share[:, None] * color / color.mean(axis=1, keepdims=True))

    plain = lit((0.06, 0.8, 1.15), (0.06, 0.8, 1.15))
    assert lit((0.06, 1.66, 3.15), (0.06, 0.3, 0.69)) - plain > 14


def test_the_color_of_what_hardly_shines_is_nobody_s_concern():
    bright = np.ones((6, 3))
    faint = np.concatenate([bright, 1e-4 * np.array([[0.0, 3.0, 0.0]])])
    white = np.concatenate([bright, 1e-4 * np.ones((1, 3))])
    assert cost(faint) == pytest.approx(cost(white), abs=1e-3)


def test_one_color_for_all_lights_keeps_its_scale():
    prior = prior_of(3, 2.0, uniform=True)
    values = np.array([2.0, 2, 2, 1, 1, 1])
    assert prior.residuals(values)[-1] == pytest.approx(0)
    brighter = np.array([1.0, 1, 1, 2, 2, 2])
    np.testing.assert_allclose(prior.residuals(values)[:-1], prior.residuals(brighter)[:-1])
    assert prior.residuals(brighter)[-1] > 10


def test_no_lights_no_residuals():
    lights = LightParameters(np.zeros(2, bool), np.ones((2, 3)), False)
    assert LightPrior(lights, 1.0).residuals(np.zeros(0)).shape == (0,)
    assert LightPrior(lights, 1.0).jacobian(np.zeros(0)).shape == (0, 0)
