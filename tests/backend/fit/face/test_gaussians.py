"""Priors of patterns, whose level is free."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.face.gaussians import LEVEL_MIN, Relative, smooth
from reference.normal_equations import normal_equations


def test_a_relative_pattern_costs_the_same_at_any_level():
    values = np.random.default_rng(0).uniform(0.4, 1.2, 25)
    pattern = Relative(smooth(25, 0.25), float(values.mean()))
    np.testing.assert_allclose(pattern.residuals(values), smooth(25, 0.25).residuals(values))
    np.testing.assert_allclose(pattern.residuals(3 * values), pattern.residuals(values))
    gradient = normal_equations(pattern, values)[1]
    assert gradient @ values == pytest.approx(0, abs=1e-9), "no pull on the level"
    assert np.abs(gradient).max() > 0.1


@pytest.mark.parametrize("level", [1.0, 0.1 * LEVEL_MIN])
def test_slope_and_normal_equations_are_those_of_the_residuals(level: float):
    values = level * np.random.default_rng(1).uniform(0.2, 1.5, 16)
    prior = Relative(smooth(16, 0.25), 0.8).scaled(1.3)
    jacobian, step = prior.jacobian(values), 1e-6 * level
    sides = [
        (prior.residuals(values + step * unit) - prior.residuals(values - step * unit)) / (2 * step)
        for unit in np.eye(16)
    ]
    np.testing.assert_allclose(jacobian, np.stack(sides, axis=1), atol=1e-5)
    hessian, gradient = normal_equations(prior, values)
    np.testing.assert_allclose(hessian, jacobian.T @ jacobian, atol=1e-9)
    np.testing.assert_allclose(gradient, jacobian.T @ prior.residuals(values), atol=1e-9)
