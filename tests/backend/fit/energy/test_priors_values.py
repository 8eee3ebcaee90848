"""What the priors cost, in numbers done by hand."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from facestage.contract.job import Weights
from facestage.fit.energy.priors import Priors
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_color import LightPrior
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.unknowns import SPECULAR_MEAN, SPECULAR_SIGMA
from reference.synthetic_scene import Scene, synthetic_scene

PRIOR, LIGHT, MEAN = 1.7, 0.6, 3.0


@pytest.fixture(scope="module")
def given(renderer: str) -> Scene:
    return synthetic_scene()


def energies(
    scene: Scene, parameters: LightParameters | None = None, **changes: Any
) -> dict[str, float]:
    state = replace(scene.state, **changes)
    known = scene.known(lights=parameters or scene.lights, expression_box=True, light_scale=MEAN)
    return Priors(Layout(state), known, Weights(prior=PRIOR, light=LIGHT)).energies(state)


def test_roughness_lens_and_expression(given: Scene):
    found = energies(given, roughness=0.55)
    assert found["roughness"] == pytest.approx(0.5 * PRIOR * 1.5**2)
    longer = replace(given.state.camera, focal_px=given.state.camera.focal_px * np.exp(0.5))
    assert energies(given, camera=longer)["focal"] == pytest.approx(0.5 * PRIOR * 2**2)
    found = energies(given, expression=np.array([0.35, 0.7, 0.0]))
    assert found["expression"] == pytest.approx(0.5 * PRIOR * (1 + 4))


def test_the_specular_map_s_level_counts_once_and_each_step_by_itself(given: Scene):
    found = energies(given, specular=np.full((6, 6), SPECULAR_MEAN + 1.5 * SPECULAR_SIGMA))
    assert found["specular_level"] == pytest.approx(0.5 * PRIOR * 1.5**2)
    assert found["specular_smooth"] == pytest.approx(0)
    # Relative to the mean: 0.8, about.
    stepped = np.full((6, 6), 0.725)
    stepped[:, 3:] += 0.15
    assert energies(given, specular=stepped)["specular_smooth"] == pytest.approx(0.5 * PRIOR * 6)
    assert energies(given, specular=stepped.T)["specular_smooth"] == pytest.approx(0.5 * PRIOR * 6)
    brighter = energies(given, specular=2 * stepped)["specular_smooth"]
    assert brighter == pytest.approx(0.5 * PRIOR * 6)


def test_light_is_what_its_own_prior_says(given: Scene):
    prior = LightPrior(given.lights, MEAN)
    wanted = 0.5 * LIGHT * (prior.residuals(given.state.lights) ** 2).sum()
    assert energies(given)["light"] == pytest.approx(wanted)


def test_lamps_stand_within_two_fifths_of_the_lattice_s_spacing(given: Scene):
    turned = np.zeros((6, 2))
    spacing = np.sqrt(2 * np.pi / 6)
    turned[2] = [0.4 * spacing, 0.8 * spacing]
    assert energies(given, light_position=turned)["light_position"] == pytest.approx(
        0.5 * PRIOR * 5
    )
    state = replace(given.state, light_position=turned)
    # Of a stage of which most lights are off, the spacing is the whole stage's.
    priors = Priors(Layout(state), given.known(stage_lights=24), Weights(prior=PRIOR))
    assert priors.energies(state)["light_position"] == pytest.approx(4 * 0.5 * PRIOR * 5)
