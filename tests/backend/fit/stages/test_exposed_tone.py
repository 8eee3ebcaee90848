"""Skin starts as light as the photo's exposure says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.files.color import REC709
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.exposure_term import EXPOSED, SIGMA
from facestage.fit.energy.known_tone import KnownTone
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.teeth_term import SIGMA as TEETH_SIGMA
from facestage.fit.energy.teeth_term import TEETH
from facestage.fit.energy.tone_term import Tone, tone_of
from facestage.fit.energy.white_skin import white_skin
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem, read_problem
from facestage.fit.stages.exposed_tone import TONE_SIGMA, as_light_as_exposed
from facestage.fit.stages.phases import PhaseName, Schedule
from facestage.fit.stages.view import View
from facestage.models.registry import load_model
from facestage.stress.scene import EXPOSURE, Scene, exposed, plain_scene, render, write_job

PHASE = Schedule()[PhaseName.LIGHT]
Person = Callable[[float], tuple[Problem, Scene]]


@cache
def tone() -> Tone:
    return tone_of(FaceGeometry(load_model("default")))


def coefficients(luminance: float) -> np.ndarray:
    """Of skin of this logarithm of luminance, by the first tone alone."""
    first = np.eye(len(tone().by_albedo))[0]
    return first * (luminance - tone().mean) / tone().by_albedo[0]


def looked_at(problem: Problem, scene: Scene) -> tuple[PhotoTerm, Evaluation]:
    """The photo beside a face of mean skin in the dark."""
    lights = np.zeros(problem.lights.size)
    state = replace(scene.state, lights=lights, albedo=0 * scene.albedo)
    view = View(problem, ForwardModel(problem.geometry, problem.lights))
    photo = view.photo_term(PHASE, state)
    assert photo is not None
    return photo, photo.evaluate(view.scaled(PHASE, state), 0)


def photographed(folder: Path, scene: Scene, exposure: float = EXPOSURE) -> Problem:
    """A photo of ``scene`` that a camera developed."""
    folder.mkdir()
    problem = read_problem(write_job(folder, scene, render(scene, exposure=exposure)))
    return replace(problem, photograph=replace(problem.photograph, developed=True))


@pytest.fixture(scope="module")
def person(renderer: str, tmp_path_factory: pytest.TempPathFactory) -> Person:
    """Somebody whose skin has this logarithm of luminance, in a photo that is exposed as usual."""
    return cache(lambda luminance: _person(tmp_path_factory.mktemp("person"), luminance))


def _person(folder: Path, luminance: float) -> tuple[Problem, Scene]:
    scene = plain_scene(load_model("default"), seed=5, side_px=96)
    scene = exposed(replace(scene, albedo=coefficients(luminance)))
    _, evaluation = looked_at(photographed(folder / "metered", scene), scene)
    radiance = scene.stage.radiance @ np.array(REC709)
    white = white_skin(evaluation.image.terms.diffuse, radiance) @ radiance
    return photographed(folder / "usual", scene, EXPOSURE * EXPOSED / white), scene


@pytest.mark.parametrize("luminance", [-2.6, -1.1])
def test_dark_and_light_people_start_near_their_own_skin(person: Person, luminance: float):
    problem, scene = person(luminance)
    found = tone().mean + tone().by_albedo @ as_light_as_exposed(
        problem, *looked_at(problem, scene)
    )
    # The prior of tones keeps its share of the way from the mean.
    kept = SIGMA**2 / (SIGMA**2 + TONE_SIGMA**2)
    assert abs(found - luminance - kept * (tone().mean - luminance)) < 0.2
    assert abs(found - tone().mean) > 0.5 * abs(luminance - tone().mean)


@pytest.mark.parametrize("brighter", [2.0, 0.5])
def test_skin_starts_where_teeth_say(person: Person, brighter: float):
    """Skin that is exposed as usual, and teeth that say its light is brighter, or dimmer."""
    problem, scene = person(float(tone().mean))
    photo, evaluation = looked_at(problem, scene)
    usual = tone().by_albedo @ as_light_as_exposed(problem, photo, evaluation)
    smiling = replace(problem)
    vars(smiling).update(teeth=brighter * EXPOSED * TEETH)
    change = tone().by_albedo @ as_light_as_exposed(smiling, photo, evaluation) - usual
    others, smiles = 1 / SIGMA**2 + 1 / TONE_SIGMA**2, TEETH_SIGMA[0] ** -2
    expected = -np.log(brighter) * smiles / (others + smiles)
    assert change == pytest.approx(expected, abs=0.1) and abs(change) > 0.3


@pytest.mark.parametrize("known", ["linear", "held", "given"])
def test_skin_stays_where_somebody_knows_better(person: Person, known: str):
    problem, scene = person(-2.6)
    photo, evaluation = looked_at(problem, scene)
    if known == "linear":
        problem = replace(problem, photograph=replace(problem.photograph, developed=False))
    elif known == "held":
        problem = replace(problem, job=replace(problem.job, freeze=("albedo",)))
    else:
        state = replace(evaluation.state, albedo=coefficients(-1.3))
        evaluation = replace(evaluation, state=state)
    np.testing.assert_array_equal(
        as_light_as_exposed(problem, photo, evaluation), evaluation.state.albedo
    )


def test_skin_starts_as_light_as_somebody_says(person: Person):
    problem, scene = person(-1.4)
    told = replace(problem, job=replace(problem.job, skin_tone=-40.0))
    skin = as_light_as_exposed(told, *looked_at(told, scene))
    np.testing.assert_array_equal(skin, KnownTone.of(problem.geometry, -40.0).coefficients())
    assert tone().by_albedo @ skin < -0.5


@pytest.mark.parametrize(("luminance", "beside_mean"), [(-2.4, False), (-1.1, True)])
def test_what_hides_a_face_is_looked_for_beside_no_skin_lighter_than_the_mean(
    person: Person, monkeypatch: pytest.MonkeyPatch, luminance: float, beside_mean: bool
):
    problem, scene = person(-1.4)
    view = View(problem, ForwardModel(problem.geometry, problem.lights))
    skin = coefficients(luminance)
    look, beside = view.visible.look_for_occluders, []

    def looked(photo: PhotoTerm, evaluation: Evaluation, radiance: np.ndarray) -> np.ndarray:
        beside.append(evaluation.state.albedo)
        return look(photo, evaluation, radiance)

    monkeypatch.setattr(view.visible, "look_for_occluders", looked)
    dark = replace(scene.state, lights=np.zeros(problem.lights.size), albedo=0 * scene.albedo)
    lit = view.with_initial_lights(PHASE, dark, skin)
    np.testing.assert_array_equal(lit.albedo, skin)
    np.testing.assert_array_equal(beside, [dark.albedo if beside_mean else skin])
    # Its lights are those of the skin that it starts with: lighter skin, dimmer light.
    of_mean = view.with_initial_lights(PHASE, dark, dark.albedo)
    assert bool(lit.lights.mean() < of_mean.lights.mean()) == beside_mean
