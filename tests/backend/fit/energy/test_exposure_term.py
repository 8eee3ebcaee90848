"""Photos are exposed so that white skin in the face's place is about white."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.brdf import matte
from facestage.contract.light_stage import FROZEN
from facestage.fit.energy.exposure_term import EXPOSED, FAINT, SIGMA, Exposure, ExposureTerm
from facestage.fit.energy.white_skin import white_skin
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.stages.phases import PhaseName, Schedule
from facestage.fit.stages.view import View
from facestage.models.registry import load_model
from facestage.stress.scene import plain_scene, render, write_job
from reference.slope_by_lights import assert_slope_by_lights


@pytest.fixture(scope="module")
def known(renderer: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, State]:
    scene = plain_scene(load_model("default"), seed=5, side_px=96)
    job = write_job(tmp_path_factory.mktemp("exposed"), scene, render(scene))
    problem = read_problem(job)
    problem = replace(problem, photograph=replace(problem.photograph, developed=True))
    lights = problem.lights.from_radiance(scene.stage.radiance)
    return problem, replace(scene.state, lights=lights)


def exposure(problem: Problem, state: State) -> Exposure | None:
    """As the first phase with light has it."""
    view = View(problem, ForwardModel(problem.geometry, problem.lights))
    descent = view.descent(Schedule()[PhaseName.LIGHT], state)
    assert descent is not None
    found = [term.exposure for term in descent.energy.terms if isinstance(term, ExposureTerm)]
    return found[0] if found else None


def test_white_skin_sends_back_what_does_not_shine_on_it():
    """Light at a right angle on all of the skin: the radiance is the irradiance over pi, less what
    the surface keeps from entering.
    """
    found = white_skin(np.full((100, 2), [0.3, 0.0]), np.ones(2))
    np.testing.assert_allclose(found, [matte(1.0, 0.3), 0.0])


def test_light_counts_where_the_face_is_lit_well():
    """Neither a lamp that grazes a tenth of the face says how bright light is, nor does shade."""
    irradiance = np.zeros((100, 2))
    irradiance[:70, 0] = 0.3
    irradiance[:10, 1] = 50.0
    found = white_skin(irradiance, np.ones(2))
    np.testing.assert_allclose(found, [matte(1.0, 0.3), 0.0], rtol=1e-9)


def test_light_is_as_bright_as_photos_are_exposed_for(known: tuple[Problem, State]):
    problem, state = known
    found = exposure(problem, state)
    assert found is not None
    white = np.exp(found.residuals(state)[0] * SIGMA) * EXPOSED - FAINT
    for gain in (1.5, 0.4):
        other = replace(state, lights=state.lights * (gain * EXPOSED - FAINT) / white)
        np.testing.assert_allclose(found.residuals(other), [np.log(gain) / SIGMA], rtol=1e-6)


def test_the_slope_is_that_of_the_residual(known: tuple[Problem, State]):
    problem, state = known
    found = exposure(problem, state)
    assert found is not None
    assert_slope_by_lights(found, state, least=0.01)


def test_a_photo_in_the_dark_has_a_finite_slope(known: tuple[Problem, State]):
    problem, state = known
    found = exposure(problem, state)
    assert found is not None
    dark = replace(state, lights=0.0 * state.lights)
    slope = found.jacobian(dark, Layout(state))
    assert np.isfinite(slope).all() and np.abs(slope).max() < 1.0 / (FAINT * SIGMA)


def test_nobody_chose_the_exposure_of_linear_files(known: tuple[Problem, State]):
    problem, state = known
    linear = replace(problem, photograph=replace(problem.photograph, developed=False))
    assert exposure(linear, state) is None


@pytest.mark.parametrize(("name", "developed"), [("photo.png", True), ("photo.exr", False)])
def test_files_of_cameras_are_developed(tmp_path: Path, name: str, developed: bool):
    from facestage.images.image_io import read_photograph, write_exr, write_png

    picture = np.full((8, 8, 3), 0.5)
    if developed:
        write_png(tmp_path / name, (255 * picture).astype(np.uint8))
    else:
        write_exr(tmp_path / name, picture)
    assert read_photograph(tmp_path / name).developed is developed


@pytest.mark.parametrize("held", [1, None], ids=["one light", "all"])
def test_light_of_known_brightness_needs_no_guess(known: tuple[Problem, State], held: int | None):
    """A light that is held says how bright the others are beside it."""
    problem, state = known
    radiance = problem.lights.radiance(state.lights) + 1.0
    light = problem.stage.state.copy()
    light[:held] = FROZEN
    stage = replace(problem.stage, radiance=radiance, state=light)
    fixed = replace(problem, stage=stage)
    lights = fixed.lights.from_radiance(radiance)
    assert exposure(fixed, replace(state, lights=lights)) is None


def test_photos_before_a_window_are_believed_sooner_than_burnt_ones(known: tuple[Problem, State]):
    problem, state = known
    found = exposure(problem, state)
    assert found is not None
    dark, bright = (found.robust_weights(np.array([each])) for each in (-2.0, 2.0))
    assert 0 < dark < bright < found.share
    assert found.robust_energy(np.array([-2.0])) < found.robust_energy(np.array([2.0]))
    # The weights are the energy's: its slope is residual times weight.
    for at in (-2.0, 0.5, 2.0):
        above, below = (found.robust_energy(np.array([at + h])) for h in (1e-5, -1e-5))
        slope = (above - below) / 2e-5
        assert slope == pytest.approx(at * float(found.robust_weights(np.array([at]))[0]), rel=1e-5)
