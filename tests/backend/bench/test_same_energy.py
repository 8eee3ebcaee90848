"""Adam minimises what the fit minimises: every term of it, the outline too, with derivatives that
are right.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.bench.adam import OUTLINE_EVERY, AdamRun, Anchors, other_terms, run_adam
from facestage.bench.settings import AdamSettings
from facestage.bench.trace import Judge
from facestage.contract.job import Weights
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.priors import Priors
from facestage.fit.energy.silhouette import Silhouette, SilhouetteTerm
from facestage.fit.energy.system import System
from facestage.fit.energy.terms import Energy
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import Known
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.photo import Photo
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.models.registry import load_model
from facestage.stress.scene import plain_scene
from reference.synthetic_scene import moved, plain_photo

WEIGHTS = Weights(landmarks=0.7, prior=1.3, light=0.6, photo=0.4)
FACE, BACK = np.array([0.5, 0.4, 0.3]), np.array([0.05, 0.08, 0.1])


@pytest.fixture(scope="module")
def problem() -> tuple[Energy, State]:
    """The energy of a head before a dark background, and a state a little off, so that every term
    pulls.
    """
    from facestage.render.variant import start_renderer

    start_renderer("cpu")
    truth = plain_scene(load_model("default"), side_px=160)
    geometry = FaceGeometry(truth.model)
    radiance = truth.stage.radiance
    lights = LightParameters(np.ones(len(radiance), bool), np.zeros_like(radiance), uniform=False)
    state = replace(
        truth.state,
        lights=lights.from_radiance(radiance),
        light_position=np.zeros((len(radiance), 2)),
    )
    forward = ForwardModel(geometry, lights)
    # Turned, so that a cheek is the outline.
    state = moved(state, pose=np.array([0, 0.7, 0, 0, 0, 0]))
    y, x = np.mgrid[: state.camera.height, : state.camera.width]
    seen = forward.hits(state, np.stack([x.ravel(), y.ravel()], axis=1) + 0.5).triangle >= 0
    photo: Photo = plain_photo(np.where(seen.reshape(*y.shape, 1), FACE, BACK))
    vertices, corner = truth.model.landmark_vertices("ibug68")
    placed = np.einsum("mi,mix->mx", corner, forward.pose(state)[1][geometry.new_index[vertices]])
    points = state.camera.project(placed) + np.random.default_rng(1).normal(size=(68, 2))
    layout = Layout(state)
    known = Known(lights, state.camera.focal_px, expression_box=truth.model.expression_box)
    landmarks = LandmarkTerm(geometry, Landmarks("ibug68", points, np.ones(68, bool)), 1.0)
    outline = SilhouetteTerm(forward, photo, 100.0)
    energy = Energy(
        layout, Priors(layout, known, WEIGHTS), landmarks, WEIGHTS, lights, silhouette=outline
    )
    uneven = np.random.default_rng(3).uniform(-0.1, 0.1, state.specular.shape)
    shift = np.array([0.01, -0.02, 0.01, 0.002, 0.001, 0.004])
    return energy, moved(
        state, pose=shift, albedo=np.full(state.albedo.size, 0.1), roughness=0.05, specular=uneven
    )


def anchors_at(energy: Energy, state: State) -> Anchors:
    """As a step of the fit takes them."""
    assert energy.silhouette is not None
    return Anchors(energy.landmarks.at(state), energy.silhouette.find(state))


def test_every_term_and_the_gradient_are_those_of_a_step_of_the_fit(problem: tuple[Energy, State]):
    energy, state = problem
    system = System(energy, state, None, np.ones(energy.layout.size, bool))
    found = other_terms(energy, state, anchors_at(energy, state))
    assert (
        set(found.energy) == set(system.terms) >= {"landmarks", "silhouette", "identity", "light"}
    )
    np.testing.assert_allclose(
        found.gradient, system.gradient, rtol=1e-9, atol=1e-9 * np.abs(system.gradient).max()
    )
    # The step's quadratic energies of robust terms are those of its frozen weights: their slope is
    # the same.
    for name in set(found.energy) - {"landmarks", "silhouette"}:
        assert found.energy[name] == pytest.approx(system.terms[name]), name
    assert found.energy["silhouette"] > system.terms["silhouette"] > 0


def test_the_gradient_agrees_with_finite_differences(problem: tuple[Energy, State]):
    energy, state = problem
    anchors = anchors_at(energy, state)
    assert anchors.outline is not None and len(anchors.outline.targets) >= 10
    gradient = other_terms(energy, state, anchors).gradient
    layout, random = energy.layout, np.random.default_rng(2)
    for name in (
        "pose",
        "focal",
        "identity",
        "expression",
        "albedo",
        "roughness",
        "specular",
        "lights",
    ):
        direction = np.zeros(layout.size)
        where = layout.slices[name]
        direction[where] = random.normal(size=where.stop - where.start)
        plus, minus = (
            other_terms(energy, layout.apply(state, sign * 1e-5 * direction), anchors).total
            for sign in (1, -1)
        )
        expected = (plus - minus) / 2e-5
        print(f"{name}: {gradient @ direction:.6g}, by differences {expected:.6g}")
        assert gradient @ direction == pytest.approx(
            expected, rel=1e-4, abs=1e-4 * np.abs(gradient[where]).max()
        ), name


def test_adam_looks_for_the_outline_and_its_loss_has_it(problem: tuple[Energy, State]):
    """The loss and its gradient with the outline, less those without it, are the outline's own."""
    energy, state = problem
    assert energy.silhouette is not None
    forward = energy.silhouette.forward
    photo = PhotoTerm(forward, energy.silhouette.photo, 1)
    stage = fibonacci_stage(len(energy.light_parameters.fitted), radius=0.8).transformed(
        state.model_to_camera
    )
    adam = AdamRun(replace(energy, photo=photo, stage=stage), state, samples=1)
    assert adam.outline is not None
    with_outline = adam.loss(state, seed=1)
    outline, adam.outline = adam.outline, None
    without = adam.loss(state, seed=1)
    residual = outline.residuals(state)
    pull = outline.jacobian(state, energy.layout).T @ (
        WEIGHTS.photo * outline.weights(residual) * residual
    )
    assert with_outline[0] - without[0] == pytest.approx(
        WEIGHTS.photo * outline.robust_energy(residual), rel=1e-3
    )
    np.testing.assert_allclose(with_outline[1] - without[1], pull, atol=1e-3 * np.abs(pull).max())
    assert np.abs(pull).max() > 0


def test_a_run_looks_for_the_outline_every_few_iterations(
    opened: tuple[Problem, Truth, Judge], monkeypatch: pytest.MonkeyPatch
):
    asked: list[State] = []
    find = SilhouetteTerm.find

    def counted(term: SilhouetteTerm, state: State) -> Silhouette | None:
        asked.append(state)
        return find(term, state)

    monkeypatch.setattr(SilhouetteTerm, "find", counted)
    run_adam(
        opened[0],
        opened[1],
        AdamSettings("Adam", resolution=0.4, iterations=2 * OUTLINE_EVERY + 1),
        detail=False,
    )
    assert len(asked) == 3
