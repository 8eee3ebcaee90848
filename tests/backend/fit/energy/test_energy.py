"""The sum of the terms, what every term keeps to, and a term that nobody knows of."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.job import Job, Weights
from facestage.contract.landmarks import Landmarks
from facestage.fit.energy import energy as sum_of_terms
from facestage.fit.energy import terms
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.plan import Plan
from facestage.fit.energy.priors import Priors
from facestage.fit.energy.robust_residuals import RobustResiduals
from facestage.fit.energy.silhouette import Silhouette, SilhouetteTerm
from facestage.fit.energy.term import Setup, Term
from facestage.fit.energy.terms import TERMS, words_of_energies
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import BLOCKS, SHARED
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.fineness import Fineness
from facestage.fit.given.problem import read_problem
from facestage.fit.stages.joint_descent import JointDescent
from facestage.fit.stages.passage import Passage, walk
from facestage.fit.stages.phases import PhaseName, Schedule
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


@pytest.fixture
def view(case: Case, small_maps: Fineness) -> View:
    landmarks, camera = Landmarks.read(case.landmarks), Camera.read(case.camera)
    job = Job(case.photo, case.model_option, landmarks, camera, device="cpu")
    problem = read_problem(job, fineness=small_maps)
    return View(problem, ForwardModel(problem.geometry, problem.lights))


@pytest.fixture
def geometry_phase(view: View) -> Passage:
    """Where a phase begins that moves shape, skin and lamps."""
    passage = Passage.prepared(view, Schedule()[PhaseName.GEOMETRY], view.start_state())
    assert passage is not None
    return passage


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
    system = energy.at(state).system(state)
    assert system.decrease(behind, None) == -np.inf
    nowhere = replace(state, identity=np.full_like(state.identity, np.nan))
    assert system.decrease(nowhere, None) == -np.inf


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


def test_every_energy_has_words_of_its_own(
    head: tuple[Energy, State], fitted: tuple[Energy, State]
):
    words = words_of_energies()
    assert len(set(words.values())) == len(words) == sum(len(term.words) for term in TERMS)
    for energy, state in (head, fitted):
        placed = energy.at(state, energy.evaluate(state, 1))
        assert placed.robust(state).keys() <= words.keys()


@pytest.mark.parametrize("kind", [Energy, Setup, Plan, *TERMS])
def test_an_energy_and_what_it_holds_are_frozen(kind: Any):
    parameters: Any = getattr(kind, "__dataclass_params__", None)
    assert parameters is not None and parameters.frozen


def test_a_phase_has_the_terms_that_have_a_say_in_it(view: View, geometry_phase: Passage):
    def kinds(passage: Passage | None) -> set[type[Term]]:
        assert passage is not None
        return {type(term) for term in passage.descent.energy.terms}

    start = view.start_state()
    landmarks, light = (
        kinds(Passage.prepared(view, Schedule()[name], start))
        for name in (PhaseName.LANDMARKS, PhaseName.LIGHT)
    )
    assert {PhotoTerm, SilhouetteTerm}.isdisjoint(landmarks)
    assert PhotoTerm in light and SilhouetteTerm not in light, "the shape rests"
    assert kinds(geometry_phase) >= {Priors, LandmarkTerm, SilhouetteTerm, PhotoTerm}


@pytest.mark.parametrize("kind", TERMS)
def test_each_term_s_slope_is_that_of_its_energy(geometry_phase: Passage, kind: type[Term]):
    """As a phase makes it; exactly but for the photo, whose derivatives have tests of their own."""
    energy, state = geometry_phase.descent.energy, geometry_phase.scaled
    mine = replace(energy, terms=tuple(one for one in energy.terms if type(one) is kind))
    placed, layout = mine.at(state), energy.layout
    slope = placed.system(state).gradient
    for seed in range(3):
        direction = np.random.default_rng(seed).normal(size=layout.size)
        sides = (layout.apply(state, sign * 1e-6 * direction) for sign in (1, -1))
        plus, minus = (sum(placed.robust(side).values()) for side in sides)
        scale = float(np.linalg.norm(slope))
        assert slope @ direction == pytest.approx((plus - minus) / 2e-6, abs=1e-4 * scale)
    if kind in (Priors, LandmarkTerm):
        assert slope.any(), "both pull"


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


@dataclass(frozen=True, eq=False)
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
def test_a_term_that_nobody_knows_of_is_in_every_step(view: View):
    assert words_of_energies()["anchor"] == "An anchor"
    heard: list[tuple[str, set[type[Term]], Iteration]] = []

    def told(passage: Passage, item: Iteration) -> None:
        kinds = {type(term) for term in passage.descent.energy.terms}
        heard.append((passage.phase.name, kinds, item))

    end = walk(view, Schedule().landmark_phases, view.start_state(), told=told)
    (first, *_, last) = heard
    assert first[0] == "pose" and AnchorTerm not in first[1], "where it has no say"
    assert last[0] == "landmarks" and last[1] >= {Priors, LandmarkTerm, AnchorTerm}
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
