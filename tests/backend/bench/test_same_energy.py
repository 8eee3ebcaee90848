"""Adam minimises what the fit minimises: every term of it, without being told which there are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.bench.adam import ANCHORS_EVERY, AdamRun, run_adam
from facestage.bench.settings import AdamSettings
from facestage.bench.trace import Judge
from facestage.contract.light_stage import fibonacci_stage
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.silhouette import Silhouette, SilhouetteTerm
from facestage.fit.face.state import State
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from reference.outlined_head import outlined_head
from reference.synthetic_scene import Scene


@pytest.fixture(scope="module")
def head(scene: Scene) -> tuple[Energy, State]:
    return outlined_head()


def test_adam_s_loss_and_gradient_have_every_term_of_the_fit_s(head: tuple[Energy, State]):
    """With all terms, less those of the photo alone, they are those of a step of the fit."""
    energy, state = head
    outline = energy.term(SilhouetteTerm)
    lights = len(outline.forward.lights.fitted)
    stage = fibonacci_stage(lights, radius=0.8).transformed(state.model_to_camera)
    photo = PhotoTerm(outline.forward, outline.photo, stage, 1)
    adam = AdamRun(replace(energy, terms=(*energy.terms, photo)), state, samples=1)
    full = adam.loss(state, seed=1)
    adam.anchors = adam.others.without(LandmarkTerm).at(state)
    fewer = adam.loss(state, seed=1)
    step = energy.at(state).system(state)
    landmarks = energy.term(LandmarkTerm).at(state).weighed(state)
    assert full[0] - fewer[0] == pytest.approx(landmarks.robust["landmarks"], rel=1e-3)
    adam.anchors = Energy(energy.layout, ()).at(state)
    alone = adam.loss(state, seed=1)
    assert full[0] - alone[0] == pytest.approx(sum(step.robust.values()), rel=1e-3)
    pull = full[1] - alone[1]
    np.testing.assert_allclose(pull, step.gradient, atol=1e-3 * np.abs(step.gradient).max())


def test_a_run_places_its_terms_every_few_iterations(
    opened: tuple[Problem, Truth, Judge], monkeypatch: pytest.MonkeyPatch
):
    asked: list[State] = []
    at = SilhouetteTerm.at

    def counted(
        term: SilhouetteTerm, state: State, evaluation: Evaluation | None = None
    ) -> Silhouette | None:
        asked.append(state)
        return at(term, state, evaluation)

    monkeypatch.setattr(SilhouetteTerm, "at", counted)
    run_adam(
        opened[0],
        opened[1],
        AdamSettings("Adam", resolution=0.4, iterations=2 * ANCHORS_EVERY + 1),
        detail=False,
    )
    assert len(asked) == 3
