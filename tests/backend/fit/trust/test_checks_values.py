"""What is asked after the last step, of a view that answers as the test says."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from facestage.contract import brdf
from facestage.contract.job import Weights
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.noise import HIGHLIGHT_SHARE
from facestage.fit.energy.plan import Ledger
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHAPE
from facestage.fit.stages.phases import Phase, PhaseName, Schedule
from facestage.fit.stages.photo_descent import Iteration
from facestage.fit.trust.certainty import Certainty
from facestage.fit.trust.checks import (
    Ending,
    _certainty,
    _known,
    _lens,
    _shading_doubt,
    conclude,
    photo_doubt,
)
from facestage.fit.trust.guard import landmark_statistic, statistic_limit
from facestage.fit.trust.lens_check import LensCheck
from facestage.fit.trust.vertex_certainty import MISFIT_FACTOR, REACH_MM, vertex_deviation
from reference.known import known
from reference.synthetic_scene import Scene, moved, plain_photo

JOINT = Phase("joint", ("pose", "lights"), 160.0, 3)
# The places of the photo that something hides; it is higher than wide.
HIDDEN = np.zeros((4, 2), bool)


def view_of(scene: Scene, held: tuple[str, ...] = (), **changes: Any) -> Any:
    """A view of the scene whose stages are those of landmarks; it tells of what it was asked."""
    layout = Layout(scene.state)
    asked: list[Any] = []
    photo = plain_photo(np.zeros((96, 96, 3)))

    def descent(phase: Phase, state: Any) -> Any:
        asked.append((phase, state))
        return changes.get("stage")

    def of(width: int, height: int) -> Any:
        asked.append((width, height))
        return photo

    def dark_at(height: int, width: int) -> np.ndarray:
        assert (height, width) == HIDDEN.shape
        return ~HIDDEN

    def unpainted_at(height: int, width: int, state: Any) -> np.ndarray:
        asked.append((height, width, state))
        return HIDDEN

    def shadowed_at(height: int, width: int, state: Any) -> np.ndarray:
        assert (height, width, state) == asked[-1]
        return np.ones(HIDDEN.shape, bool)

    problem = SimpleNamespace(
        camera=SimpleNamespace(width=2, height=4),
        fineness=SimpleNamespace(settled_share=0.05),
        fit_focal=changes.get("fit_focal", False),
        job=SimpleNamespace(weights=changes.get("weights", Weights()), seed=5),
        geometry=scene.geometry,
        lights=scene.lights,
        lit=np.ones(6, bool),
    )
    return SimpleNamespace(
        asked=asked,
        problem=problem,
        forward=scene.forward,
        free_shape=lambda _: changes.get("free", 7),
        descent=descent,
        start_state=lambda: scene.state,
        frozen=lambda: set(held),
        held=lambda _: layout.mask(held),
        anchor=lambda state: ("anchored", state),
        placed_stage=lambda state: ("placed", state),
        visible=SimpleNamespace(
            of=of, dark_at=dark_at, unpainted_at=unpainted_at, shadowed_at=shadowed_at
        ),
        plan=SimpleNamespace(ledger=Ledger()),
        penumbra=0.25,
        surround=None,
        below=None,
        between=None,
    )


def step_of(scene: Scene, evaluation: Evaluation | None, **changes: Any) -> Any:
    """A last step whose normal equations say 4 of each parameter, the priors' part of them 1."""
    size = Layout(scene.state).size
    given = {"hessian": 4.0 * np.eye(size), "prior_hessian": np.eye(size), "condition": 17.0}
    return SimpleNamespace(
        state=scene.state, evaluation=evaluation, energy={"photo": 2.0}, **(given | changes)
    )


@pytest.fixture(scope="module")
def evaluation(scene: Scene) -> Evaluation:
    return scene.photo_term(scene.render(samples=4)[0], 2).evaluate(scene.state, 1)


def test_the_photo_is_doubted_by_the_landmarks_its_likeness_and_what_it_shows(
    scene: Scene, evaluation: Evaluation
):
    stage = scene.solver(np.zeros((96, 96, 3)), ("pose",), 1, Weights())
    view, last = view_of(scene, stage=stage), step_of(scene, evaluation)
    end = moved(scene.state, identity=[0.5, 0, 0, 0])
    words, statistic = photo_doubt(view, scene.state, end, last, None)
    assert statistic == landmark_statistic(stage.energy, scene.state, end) != 0
    # The photo is black, and is looked at in the size of the last evaluation, to the pixel.
    assert "black" in words
    assert view.asked == [(Schedule()[PhaseName.LANDMARKS], scene.state), (96, 96)]
    # A pull that no face explains, by one free parameter; by seven it would.
    far = moved(scene.state, identity=[0.5, 0, 0, 0.75])
    pull = landmark_statistic(stage.energy, scene.state, far)
    assert statistic_limit(1) < pull, f"{pull:.1f}"
    assert (
        "squared distance"
        in photo_doubt(view_of(scene, stage=stage, free=1), scene.state, far, last, None)[0]
    )


def test_nothing_is_doubted_where_nothing_was_fitted(scene: Scene, evaluation: Evaluation):
    view = view_of(scene)
    for last in (None, step_of(scene, None)):
        assert photo_doubt(view, scene.state, scene.state, last, 1.0) == ("", 0.0)
    nothing_free, last = view_of(scene, free=0), step_of(scene, evaluation)
    assert photo_doubt(nothing_free, scene.state, scene.state, last, 1.0) == ("", 0.0)
    assert not view.asked and not nothing_free.asked


@pytest.mark.parametrize(
    "changes",
    [{"fit_focal": True}, {"weights": Weights(landmarks=0)}, {"weights": Weights(prior=0)}],
)
def test_the_lens_is_asked_about_only_where_landmarks_and_priors_can_speak(
    scene: Scene, changes: dict[str, Any]
):
    view = view_of(scene, **changes)
    assert _lens(view, scene.state) is None and not view.asked


def test_the_lens_is_asked_about_in_six_steps_of_the_shape(scene: Scene):
    view = view_of(scene)
    assert _lens(view, scene.state) == LensCheck(1.0, 0.0)
    assert view.asked == [(Phase("lens", SHAPE, None, 6), scene.state)]


def certainty_of(view: Any, state: State, last: Iteration) -> Certainty:
    """By what ``last`` says."""
    return _certainty(view, state, _known(view, state, last))


def test_certainty_is_the_inverse_of_the_last_normal_equations(scene: Scene):
    assert not known(_certainty(view_of(scene), scene.state, None)).deviations
    layout = Layout(scene.state)
    prior = np.eye(layout.size)
    # Nothing but its prior holds the second mode.
    prior[layout.slices["identity"].start + 1] *= 4
    last = step_of(scene, None, prior_hessian=prior)
    found = certainty_of(view_of(scene, held=("roughness", "albedo", "relief")), scene.state, last)
    np.testing.assert_allclose(found.deviations["identity"], 0.5)
    np.testing.assert_allclose(found.before["identity"], [1, 0.5, 1, 1])
    np.testing.assert_array_equal(found.deviations["roughness"], 0)
    assert found.unobserved == {"identity": [scene.model.identity_names[1]]}
    # Half the deviation of every mode is half that of every vertex, but for what no mode can say.
    sharper = certainty_of(
        view_of(scene, held=("relief",)),
        scene.state,
        step_of(scene, None, hessian=16 * np.eye(layout.size)),
    )
    vertices = known(found.vertices_mm)
    assert vertices.shape == scene.model.vertices.shape and vertices.max() > 0.1
    both = (vertices, known(sharper.vertices_mm))
    of_modes, sharp = (np.sqrt(each.astype(float) ** 2 - REACH_MM**2) for each in both)
    np.testing.assert_allclose(sharp, 0.5 * of_modes, atol=1e-3)
    assert vertices.min() >= REACH_MM and of_modes.max() > 0.1
    model = scene.model
    alone = vertex_deviation(
        model,
        model.shape(scene.state.identity, scene.state.expression),
        scene.state.rotation,
        0.25 * np.eye(7),
        model.regions["narrow_face"],
    )
    np.testing.assert_allclose(of_modes, MISFIT_FACTOR * alone, rtol=1e-2, atol=1e-2)
    frozen = certainty_of(
        view_of(scene, held=("identity", "expression", "relief")), scene.state, last
    )
    assert not known(frozen.vertices_mm).any()
    # Of identity, expression and light; the rest is held, or not asked about.
    assert found.directions["of"] == 4 + 3 + 18


def test_where_no_shape_moves_a_highlight_is_all_that_is_doubted(
    scene: Scene, evaluation: Evaluation
):
    view = view_of(scene, held=tuple(Layout(scene.state).slices))
    assert _shading_doubt(view, None, None) is None
    for last in (step_of(scene, None), step_of(scene, evaluation)):
        shading = _shading_doubt(view, last, _known(view, scene.state, last))
        assert (shading is None) == (last.evaluation is None)
    found = known(shading)
    image = evaluation.image
    x, y = image.surface.pixels.astype(int).T
    diffuse = brdf.K_DIFFUSE / np.pi * (image.albedo * image.diffuse).mean(axis=1)
    gloss = HIGHLIGHT_SHARE * image.c_spec * image.specular.mean(axis=1)
    np.testing.assert_allclose(found[y, x], np.minimum(gloss / diffuse, 2.0), rtol=1e-6)


def test_a_fit_ends_with_what_its_last_step_said(scene: Scene):
    view = view_of(scene, held=("pose",), fit_focal=True)
    trace = [{"stage": "joint", "photo_rms": error} for error in (1.0, 0.9, 0.8)]
    end = replace(scene.state, roughness=0.3)
    ending = Ending(JOINT, scene.state, end, step_of(scene, None), trace, "a doubt", 6.5)
    found = conclude(view, ending, 12.5, in_time=True)
    assert found.state is end and found.trace is trace and found.hidden is HIDDEN
    assert found.shadowed.all()
    assert (found.dark == ~HIDDEN).all() and (*HIDDEN.shape, end) in view.asked
    anchored: Any = ("anchored", end)
    placed: Any = ("placed", end)
    assert (found.camera_to_stage, found.stage) == (anchored, placed)
    assert (found.energy, found.condition) == ({"photo": 2.0}, 17.0)
    assert (found.seconds, found.in_time, found.settled) == (12.5, True, False)
    assert 0 <= found.check_seconds < 60
    assert (found.doubt, found.landmark_statistic, found.penumbra) == ("a doubt", 6.5, 0.25)
    assert found.ledger is view.plan.ledger and found.lens is None
    assert found.shading_doubt is None
    np.testing.assert_allclose(found.certainty.deviations["identity"], 0.5)


def test_a_fit_without_a_step_says_nothing(scene: Scene):
    view = view_of(scene)
    found = conclude(view, Ending(JOINT, scene.state, scene.state, None, []), 0.0, in_time=False)
    assert (found.energy, found.condition, found.doubt, found.landmark_statistic) == ({}, 1, "", 0)
    assert not found.settled and not found.in_time and not found.certainty.deviations
    # The lens is asked about where the landmark stage ended.
    assert found.lens == LensCheck(1.0, 0.0) and view.asked[0][1] is scene.state


@pytest.mark.parametrize(("error", "settled"), [(0.94, False), (0.96, True)])
def test_a_phase_of_two_steps_is_asked_about_them(scene: Scene, error: float, settled: bool):
    trace = [{"stage": "joint", "photo_rms": rms} for rms in (1.0, error)]
    phase = replace(JOINT, steps=2)
    ending = Ending(phase, scene.state, scene.state, None, trace)
    assert conclude(view_of(scene), ending, 0.0, in_time=True).settled is settled
