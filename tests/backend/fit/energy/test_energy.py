"""The sum of the terms, what every term keeps to, and a term that nobody knows of."""

from __future__ import annotations

from dataclasses import FrozenInstanceError, dataclass, replace
from typing import ClassVar, Self

import numpy as np
import pytest

from facestage.contract.job import Job, Weights
from facestage.contract.landmarks import Landmarks
from facestage.fit.energy import energy as sum_of_terms
from facestage.fit.energy import terms
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.priors import Priors
from facestage.fit.energy.robust_residuals import RobustResiduals
from facestage.fit.energy.silhouette import Silhouette, SilhouetteTerm
from facestage.fit.energy.term import Setup, Term
from facestage.fit.energy.terms import TERMS, words_of_energies
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import BLOCKS, SHARED
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import read_problem
from facestage.fit.stages.joint_descent import JointDescent
from facestage.fit.stages.passage import Passage, walk
from facestage.fit.stages.phases import Schedule
from facestage.fit.stages.photo_descent import Iteration
from facestage.fit.stages.view import View
from reference.outlined_head import outlined_head
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene


@pytest.fixture(scope="module")
def head(renderer: str) -> tuple[Energy, State]:
    return outlined_head()


@pytest.fixture(scope="module")
def fitted(scene: Scene) -> tuple[Energy, State]:
    photo, _ = scene.render(samples=4)
    return scene.solver(photo, BLOCKS, 1, Weights(), samples=2).energy, scene.state


def test_gradient_and_robust_energies_belong_together(head: tuple[Energy, State]):
    """By every block, while what the terms compare is held; the outline is seen."""
    energy, state = head
    placed, layout, random = energy.at(state), energy.layout, np.random.default_rng(2)
    outline = energy.term(SilhouetteTerm).at(state)
    assert isinstance(outline, Silhouette) and len(outline.targets) >= 10
    gradient = placed.system(state).gradient
    for name in set(BLOCKS) - {"light_position"}:
        direction, where = np.zeros(layout.size), layout.slices[name]
        direction[where] = random.normal(size=where.stop - where.start)
        sides = (layout.apply(state, sign * 1e-5 * direction) for sign in (1, -1))
        plus, minus = (sum(placed.robust(side).values()) for side in sides)
        expected = (plus - minus) / 2e-5
        print(f"{name}: {gradient @ direction:.6g}, by differences {expected:.6g}")
        scale = np.abs(gradient[where]).max()
        assert gradient @ direction == pytest.approx(expected, rel=1e-4, abs=1e-4 * scale), name


def test_the_model_predicts_the_decrease_of_a_small_step(head: tuple[Energy, State]):
    """Under frozen weights: exactly for what is linear, to the third order for the rest."""
    energy, state = head
    system = energy.at(state).system(state)
    step = 1e-4 * np.random.default_rng(4).normal(size=energy.layout.size)
    predicted = -float(system.gradient @ step + 0.5 * step @ system.hessian @ step)
    found = system.decrease(energy.layout.apply(state, step), None)
    assert found == pytest.approx(predicted, rel=1e-2)
    assert system.decrease(state, None) == pytest.approx(0, abs=1e-12)


def test_a_face_behind_the_camera_is_no_step(head: tuple[Energy, State]):
    energy, state = head
    behind = replace(state, translation=-state.translation)
    assert energy.at(state).system(state).decrease(behind, None) == -np.inf


def test_robust_terms_weigh_what_is_far_less(head: tuple[Energy, State]):
    energy, state = head
    system = energy.at(state).system(state)
    assert set(system.robust) == set(system.energies) >= {"landmarks", "silhouette", "identity"}
    assert system.total == pytest.approx(sum(system.energies.values()))
    for name in ("landmarks", "silhouette"):
        assert system.robust[name] > system.energies[name] > 0
    for name in set(system.energies) - {"landmarks", "silhouette"}:
        assert system.robust[name] == system.energies[name]


def test_a_system_is_the_sum_of_its_terms_alone(fitted: tuple[Energy, State]):
    energy, state = fitted
    evaluation = energy.evaluate(state, 1)
    parts = [replace(energy, terms=(term,)) for term in energy.terms]
    whole, *each = (one.at(state, evaluation).system(state) for one in (energy, *parts))
    assert len(each) == 3
    scale = np.abs(whole.hessian).max()
    np.testing.assert_allclose(
        whole.hessian, sum(one.hessian for one in each), rtol=1e-9, atol=1e-12 * scale
    )
    assert whole.energies == {k: v for one in each for k, v in one.energies.items()}
    np.testing.assert_array_equal(whole.prior_hessian, each[0].hessian)
    assert not each[1].prior_hessian.any(), "what is no prior is not known before"


def test_without_an_evaluation_the_photo_is_silent(fitted: tuple[Energy, State]):
    energy, state = fitted
    assert "photo" not in energy.at(state).system(state).energies
    assert energy.without(PhotoTerm).evaluate(state, 1) is None
    with pytest.raises(LookupError, match="SilhouetteTerm"):
        energy.term(SilhouetteTerm)


def test_every_energy_has_words_of_its_own(head: tuple[Energy, State]):
    energy, state = head
    words = words_of_energies()
    assert set(energy.at(state).robust(state)) | {"photo"} == set(words)
    assert len(set(words.values())) == len(words)


def test_an_energy_and_its_terms_are_frozen(
    head: tuple[Energy, State], fitted: tuple[Energy, State]
):
    photo = fitted[0].photo
    assert photo is not None
    held = [head[0], *head[0].terms, photo, photo.plan]
    assert {type(one) for one in held} >= set(TERMS)
    for one in held:
        for name in vars(one):
            with pytest.raises(FrozenInstanceError):
                setattr(one, name, None)


@dataclass(frozen=True, eq=False)
class Anchor(RobustResiduals):
    """Every identity mode measured as 0.5, each with a deviation of 0.1."""

    name: ClassVar = "anchor"
    weight: float = 1.0
    share: float = 1.0

    def residuals(self, state: State) -> np.ndarray:
        return (state.identity - 0.5) / 0.1

    def jacobian(self, state: State, layout: Layout) -> np.ndarray:
        return np.eye(layout.size)[layout.slices["identity"]] / 0.1


class AnchorTerm(Term):
    words: ClassVar = {"anchor": "An anchor"}

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        return cls() if setup.moves(("identity",)) else None

    def at(self, state: State, evaluation: Evaluation | None = None) -> Anchor:
        return Anchor()


@pytest.fixture
def anchored(monkeypatch: pytest.MonkeyPatch) -> None:
    """A line in the list of terms."""
    more = (*TERMS, AnchorTerm)
    monkeypatch.setattr(terms, "TERMS", more)
    monkeypatch.setattr(sum_of_terms, "TERMS", more)


@pytest.mark.usefixtures("anchored")
def test_a_term_that_nobody_knows_of_is_in_every_step(case: Case):
    assert words_of_energies()["anchor"] == "An anchor"
    job = Job(case.photo, case.model_option, Landmarks.read(case.landmarks), device="cpu")
    problem = read_problem(job)
    view = View(problem, ForwardModel(problem.geometry, problem.lights))
    heard: list[tuple[str, set[type[Term]], Iteration]] = []

    def told(passage: Passage, item: Iteration) -> None:
        kinds = {type(term) for term in passage.descent.energy.terms}
        heard.append((passage.phase.name, kinds, item))

    end = walk(view, Schedule().landmark_phases, view.start_state(), told=told)
    (first, *_, last) = heard
    assert first[:2] == ("pose", {Priors, LandmarkTerm}), "where it has no say it is not made"
    assert last[:2] == ("landmarks", {Priors, LandmarkTerm, AnchorTerm})
    assert "anchor" in last[2].energy
    assert np.abs(end.identity - 0.5).max() < 0.2


@pytest.mark.usefixtures("anchored")
def test_each_photo_of_a_person_has_it_and_priors_count_once(scene: Scene):
    photo, _ = scene.render(samples=4)
    stages = [scene.solver(photo, BLOCKS, 1, Weights(), samples=2) for _ in range(2)]
    for stage in stages:
        stage.energy = replace(stage.energy, terms=(*stage.energy.terms, AnchorTerm()))
    joint = JointDescent(stages)
    states = (scene.state, scene.state)
    first, second = joint.system(states, joint.evaluate(states, 1)).systems
    assert first.energies["anchor"] == second.energies["anchor"] > 0
    assert set(first.energies) - set(second.energies) >= {"identity", "albedo", "roughness"}
    assert "identity" in stages[1].energy.at(scene.state).robust(scene.state), "a copy lost them"
    assert joint.descents[1].energy.term(Priors).omitted == frozenset(SHARED)
