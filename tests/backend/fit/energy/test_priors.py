"""The quadratic priors: gradient and Hessian against finite differences, and what each term is
about.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.job import Weights
from facestage.fit.energy.energy import Energy, System
from facestage.fit.energy.priors import Priors
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import EXPRESSION_SIGMA
from reference.synthetic_scene import Scene, moved

WEIGHTS = Weights(prior=1.7, light=0.6)


def priors_of(scene: Scene, weights: Weights = WEIGHTS) -> Priors:
    # Around another focal length, so that its term has a slope.
    known = scene.known(expression_box=True, light_scale=3.0, focal_px=180.0)
    return Priors(Layout(scene.state), known, weights)


def quadratic_of(priors: Priors, state: State) -> System:
    return Energy(priors.layout, (priors,)).at(state).system(state)


@pytest.fixture(params=["multi", "uniform"])
def each_scene(request: pytest.FixtureRequest, scene: Scene, uniform_scene: Scene) -> Scene:
    return scene if request.param == "multi" else uniform_scene


def test_gradient_and_hessian_equal_finite_differences(each_scene: Scene):
    priors, layout = priors_of(each_scene), Layout(each_scene.state)
    quadratic = quadratic_of(priors, each_scene.state)
    np.testing.assert_allclose(quadratic.hessian, quadratic.hessian.T)
    assert np.linalg.eigvalsh(quadratic.hessian).min() > -1e-9
    step = 1e-4
    worst = np.zeros(2)
    # Colors of light, and patterns of gloss, are ratios: their Hessian is Gauss and Newton's.
    inexact = np.flatnonzero(layout.mask(["lights", "specular"]))
    for column in range(layout.slices["focal"].start, layout.size):
        increment = np.zeros(layout.size)
        increment[column] = step
        sides = [layout.apply(each_scene.state, sign * increment) for sign in (1, -1)]
        energy = [sum(priors.energies(side).values()) for side in sides]
        slope = (energy[0] - energy[1]) / (2 * step)
        gradients = [quadratic_of(priors, side).gradient for side in sides]
        row = (gradients[0] - gradients[1]) / (2 * step)
        worst[0] = max(
            worst[0], abs(slope - quadratic.gradient[column]) / np.abs(quadratic.gradient).max()
        )
        if column not in inexact:
            worst[1] = max(
                worst[1],
                np.abs(row - quadratic.hessian[column]).max() / np.abs(quadratic.hessian).max(),
            )
    print(f"priors: gradient error {worst[0]:.1e}, Hessian error {worst[1]:.1e}, allowed 1e-6")
    assert worst.max() < 1e-6


def test_the_pose_has_no_prior(scene: Scene):
    quadratic = quadratic_of(priors_of(scene), scene.state)
    pose = Layout(scene.state).slices["pose"]
    assert not quadratic.hessian[pose].any() and not quadratic.gradient[pose].any()


def test_energies_agree_with_the_quadratic(each_scene: Scene):
    priors = priors_of(each_scene)
    quadratic = quadratic_of(priors, each_scene.state)
    assert priors.energies(each_scene.state) == pytest.approx(quadratic.energies)


def test_known_values(scene: Scene):
    energy = priors_of(scene).energies(scene.state)
    assert energy["identity"] == pytest.approx(1.7 * 0.5 * (scene.state.identity**2).sum())
    assert energy["albedo"] == pytest.approx(1.7 * 0.5 * (scene.state.albedo**2).sum())


def test_weights_scale_their_terms_only(scene: Scene):
    base = priors_of(scene, Weights()).energies(scene.state)
    prior = priors_of(scene, Weights(prior=3)).energies(scene.state)
    light = priors_of(scene, Weights(light=3)).energies(scene.state)
    for name, value in base.items():
        about_light = name == "light"
        assert prior[name] == pytest.approx(value * (1 if about_light else 3)), name
        assert light[name] == pytest.approx(value * (3 if about_light else 1)), name


def test_white_lights_cost_less_than_colored_ones(scene: Scene):
    """E_light punishes color, not brightness shared by the channels (Dib et al. 2019, eq. 5)."""
    radiance = scene.lights.radiance(scene.state.lights)
    white = np.repeat(radiance.mean(1, keepdims=True), 3, axis=1)
    priors = priors_of(scene)

    def cost(values: np.ndarray) -> float:
        return priors.energies(replace(scene.state, lights=scene.lights.from_radiance(values)))[
            "light"
        ]

    assert (
        cost(white)
        < cost(radiance)
        < cost(np.stack([radiance.sum(1), 0 * white[:, 0], 0 * white[:, 0]], 1))
    )


def test_a_smooth_specular_map_costs_less(scene: Scene):
    priors = priors_of(scene)
    flat = replace(
        scene.state, specular=np.full_like(scene.state.specular, scene.state.specular.mean())
    )
    assert priors.energies(flat)["specular_smooth"] == pytest.approx(0, abs=1e-12)
    assert priors.energies(scene.state)["specular_smooth"] > 0.1
    # One texel has no neighbour.
    single = replace(scene.state, specular=np.full((1, 1), 0.8))
    one = Priors(Layout(single), scene.known(), WEIGHTS)
    assert np.isfinite(quadratic_of(one, single).hessian).all()


def test_the_expression_prior_follows_the_model(scene: Scene):
    layout = Layout(scene.state)
    state = moved(scene.state, expression=[0.1, 0.1, 0.1])
    energies = [
        Priors(layout, scene.known(expression_box=box), Weights()).energies(state)["expression"]
        for box in (True, False)
    ]
    assert energies[1] == pytest.approx(0.5 * (state.expression**2).sum())
    assert energies[0] > energies[1]


def test_each_expression_may_have_its_own_prior(scene: Scene):
    layout = Layout(scene.state)
    state = moved(scene.state, expression=[0.1, 0.2, 0.3])
    box = np.array([False, True, False])
    energy = Priors(layout, scene.known(expression_box=box), Weights()).energies(state)[
        "expression"
    ]
    sigma = np.array([1.0, EXPRESSION_SIGMA, 1.0])
    assert energy == pytest.approx(0.5 * ((state.expression / sigma) ** 2).sum())


@pytest.mark.parametrize("uniform", [False, True])
def test_frozen_lights_have_no_prior(scene: Scene, uniform: bool):
    lights = LightParameters(np.zeros(6, bool), np.ones((6, 3)), uniform)
    state = replace(scene.state, lights=lights.from_radiance(np.ones((6, 3))))
    priors = Priors(Layout(state), scene.known(lights=lights), WEIGHTS)
    quadratic = quadratic_of(priors, state)
    assert quadratic.energies["light"] == pytest.approx(0, abs=1e-9)
    assert np.isfinite(quadratic.hessian).all()


def test_each_expression_may_have_its_own_deviation(scene: Scene):
    layout = Layout(scene.state)
    state = moved(scene.state, expression=[0.1, 0.2, 0.3])
    sigma = np.array([0.04, 0.35, 0.35])
    known = scene.known(expression_box=np.array([True, True, False]), expression_sigma=sigma)
    energy = Priors(layout, known, Weights()).energies(state)["expression"]
    expected = state.expression / [0.04, 0.35, 1.0]  # statistical ones keep their own
    assert energy == pytest.approx(0.5 * (expected**2).sum())
