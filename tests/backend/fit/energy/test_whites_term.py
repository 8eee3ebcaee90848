"""The whites of the eyes say how bright light is, and of which color, where eyes are open."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.fit.energy.white_reference import AXES
from facestage.fit.energy.whites_term import Whites, WhitesTerm
from facestage.fit.face.eye_white import eye_is_open
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.stages.phases import PhaseName, Schedule
from facestage.fit.stages.view import View
from facestage.models.registry import load_model
from facestage.stress.scene import Scene, exposed, plain_scene, render, write_job
from reference.slope_by_lights import assert_slope_by_lights

SIDE = 256
LIDS = ("eyeBlinkLeft", "eyeBlinkRight")


def looking(closed: bool = False, tint: tuple[float, float, float] = (1, 1, 1)) -> Scene:
    scene = plain_scene(load_model("default"), seed=5, side_px=SIDE)
    names = scene.model.expression_names
    lids = np.array([float(closed and name in LIDS) for name in names])
    stage = scene.stage.with_radiance(scene.stage.radiance * np.array(tint))
    return exposed(replace(scene, expression=lids, albedo=0 * scene.albedo, stage=stage))


def problem_of(folder: Path, scene: Scene) -> Problem:
    return read_problem(write_job(folder, scene, render(scene)))


def state_of(problem: Problem, scene: Scene) -> State:
    return replace(scene.state, lights=problem.lights.from_radiance(scene.stage.radiance))


def whites(problem: Problem, state: State) -> Whites | None:
    """As the first phase with light has them."""
    view = View(problem, ForwardModel(problem.geometry, problem.lights))
    descent = view.descent(Schedule()[PhaseName.LIGHT], state)
    assert descent is not None
    found = [term.whites for term in descent.energy.terms if isinstance(term, WhitesTerm)]
    return found[0] if found else None


@pytest.fixture(scope="module")
def known(renderer: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, State, Whites]:
    scene = looking(tint=(1.3, 1.0, 0.7))
    problem = problem_of(tmp_path_factory.mktemp("open"), scene)
    state = state_of(problem, scene)
    found = whites(problem, state)
    assert found is not None
    return problem, state, found


def test_the_true_light_is_believed(known: tuple[Problem, State, Whites]):
    """In a phase whose photo has a face of 64 pixels; eyes are looked at in the whole photo."""
    _, state, found = known
    residuals = found.residuals(state)
    print(f"at the truth {residuals.round(2)} standard deviations")
    assert np.abs(residuals).max() < 0.7


def test_too_bright_and_too_red_light_is_found_out(known: tuple[Problem, State, Whites]):
    problem, state, found = known
    radiance = problem.lights.radiance(state.lights)
    for gain in ((1.5, 1.5, 1.5), (1.3, 1.0, 1 / 1.3)):
        other = replace(state, lights=problem.lights.from_radiance(radiance * np.array(gain)))
        change = found.residuals(other) - found.residuals(state)
        np.testing.assert_allclose(change, AXES @ np.log(gain) / found.deviation, atol=1e-9)


def test_light_that_is_far_off_is_pulled_less_than_light_nearby(
    known: tuple[Problem, State, Whites],
):
    """Whites of narrow eyes lie in the shade of lids, and what is no eye says nothing."""
    problem, state, found = known
    radiance = problem.lights.radiance(state.lights)

    def pull(gain: float) -> float:
        residuals = found.residuals(
            replace(state, lights=problem.lights.from_radiance(radiance * gain))
        )
        return abs(float((found.robust_weights(residuals) * residuals)[0]))

    assert pull(1.25) > 1.1 * max(pull(4.0), pull(0.25))


def test_the_slope_is_that_of_the_residuals(known: tuple[Problem, State, Whites]):
    _, state, found = known
    assert_slope_by_lights(found, state, least=1e-3)


def test_closed_lids_say_nothing(
    known: tuple[Problem, State, Whites], tmp_path: Path, renderer: str
):
    problem, state, _ = known
    asleep = looking(closed=True)
    lidded = problem_of(tmp_path, asleep)
    assert whites(lidded, state_of(lidded, asleep)) is None, "no white is seen"
    awake = replace(state_of(lidded, asleep), expression=state.expression)
    assert whites(lidded, awake) is None, "a lid is where the white should be"
    masked = replace(problem.photograph, mask=np.zeros_like(problem.photograph.mask))
    assert whites(replace(problem, photograph=masked), state) is None
    worn = replace(problem)
    vars(worn).update(skin=problem.skin, frame=np.ones(problem.skin.shape, bool))
    assert whites(worn, state) is None, "glass is before it"


@pytest.mark.parametrize(
    ("skin", "expected"),
    [
        pytest.param((0.35, 0.22, 0.16), True, id="light"),
        pytest.param((0.10, 0.09, 0.09), True, id="dark and grey"),
        pytest.param((0.40, 0.38, 0.36), False, id="a lid beside grey skin in shadow"),
        pytest.param((0.45, 0.30, 0.22), True, id="brighter than its whites"),
    ],
)
def test_an_eye_is_paler_or_much_lighter_than_skin(skin: tuple[float, ...], expected: bool):
    white = np.array([0.45, 0.42, 0.40])
    assert eye_is_open(white, np.tile(skin, (5, 1))) is expected
    lid = 1.3 * np.array(skin)
    assert not eye_is_open(lid, np.tile(skin, (5, 1)))


def test_light_that_is_known_needs_no_whites(known: tuple[Problem, State, Whites]):
    problem, state, _ = known
    held = replace(problem, job=replace(problem.job, freeze=("lights",)))
    stage = replace(problem.stage, radiance=problem.lights.radiance(state.lights))
    held = replace(held, stage=stage)
    assert whites(held, replace(state, lights=np.zeros(0))) is None
