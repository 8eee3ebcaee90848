"""Teeth say how bright light is, and of which color."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.energy.teeth_term import TEETH, Teeth, TeethTerm
from facestage.fit.energy.white_reference import AXES
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.stages.phases import PhaseName, Schedule
from facestage.fit.stages.view import View
from facestage.models.registry import load_model
from facestage.stress.scene import exposed, plain_scene, render, write_job
from reference.slope_by_lights import assert_slope_by_lights


def teeth(problem: Problem, state: State, phase: str = PhaseName.LIGHT) -> Teeth | None:
    """As the phase has them."""
    view = View(problem, ForwardModel(problem.geometry, problem.lights))
    descent = view.descent(Schedule()[phase], state)
    assert descent is not None
    found = [term.teeth for term in descent.energy.terms if isinstance(term, TeethTerm)]
    return found[0] if found else None


def showing(problem: Problem, color: np.ndarray | None) -> Problem:
    """The same with teeth of this radiance."""
    other = replace(problem)
    vars(other).update(teeth=color)
    return other


@pytest.fixture(scope="module")
def known(
    renderer: str, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Problem, State, np.ndarray]:
    """And the radiance of white skin under its light."""
    scene = exposed(plain_scene(load_model("default"), seed=5, side_px=96))
    problem = read_problem(write_job(tmp_path_factory.mktemp("teeth"), scene, render(scene)))
    state = replace(scene.state, lights=problem.lights.from_radiance(scene.stage.radiance))
    found = teeth(showing(problem, TEETH), state)
    assert found is not None
    white = found.by_light @ problem.lights.radiance(state.lights) / TEETH[:, None]
    return problem, state, np.diag(white)


def test_teeth_are_beside_white_skin_where_the_face_is_lit_well(
    known: tuple[Problem, State, np.ndarray],
):
    problem, state, white = known
    found = teeth(showing(problem, TEETH * white), state)
    assert found is not None
    np.testing.assert_allclose(found.residuals(state), 0.0, atol=1e-9)
    lit = problem.photograph.color[problem.photograph.mask & (problem.skin > 0.5)]
    albedo = np.exp(problem.geometry.log_albedo[problem.geometry.fitted_vertices])
    np.testing.assert_allclose(
        np.quantile(lit, 0.6, axis=0) / np.median(albedo, axis=0), white, rtol=0.3
    )


@pytest.mark.parametrize("gain", [0.5, 2.0])
def test_light_is_as_bright_as_teeth_say(known: tuple[Problem, State, np.ndarray], gain: float):
    """The brightest of them, which no lip shades: dimmer light is as unlikely as brighter light."""
    problem, state, white = known
    found = teeth(showing(problem, TEETH * white), state)
    assert found is not None
    off = found.residuals(replace(state, lights=gain * state.lights))
    np.testing.assert_allclose(off, [np.log(gain) / 0.22, 0.0, 0.0], atol=1e-9)


def test_the_light_has_the_color_of_teeth(known: tuple[Problem, State, np.ndarray]):
    problem, state, white = known
    found = teeth(showing(problem, TEETH * white), state)
    assert found is not None
    radiance = problem.lights.radiance(state.lights)
    for gain in ([1.2, 1.0, 0.8], [0.9, 1.1, 0.9]):
        off = AXES @ np.log(gain)
        lit = replace(state, lights=problem.lights.from_radiance(radiance * np.array(gain)))
        expected = off / found.deviation
        np.testing.assert_allclose(found.residuals(lit), expected, atol=1e-9)


@pytest.mark.parametrize("gain", [0.7, 1.4])
def test_the_slope_is_that_of_the_residuals(known: tuple[Problem, State, np.ndarray], gain: float):
    problem, state, white = known
    found = teeth(showing(problem, gain * TEETH * white), state)
    assert found is not None
    assert_slope_by_lights(found, state, least=1e-3)


def test_light_is_compared_with_teeth_that_are_seen(known: tuple[Problem, State, np.ndarray]):
    problem, state, _ = known
    assert problem.teeth is None, "its mouth is shut"
    assert teeth(problem, state) is None
    stage = replace(problem.stage, radiance=problem.lights.radiance(state.lights))
    held = replace(problem, job=replace(problem.job, freeze=("lights",)), stage=stage)
    assert teeth(showing(held, TEETH), replace(state, lights=np.zeros(0))) is None


def test_a_photo_without_a_hue_shows_no_teeth(
    known: tuple[Problem, State, np.ndarray], monkeypatch: pytest.MonkeyPatch
):
    problem, _, _ = known
    monkeypatch.setattr("facestage.fit.given.problem.teeth_color", lambda *_: TEETH)
    assert replace(problem).teeth is TEETH
    assert replace(problem, photograph=replace(problem.photograph, tinted=True)).teeth is None
