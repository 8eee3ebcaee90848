"""What the plan leaves out changes nothing: each rule alone, all of them, and the words that say
what it saved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from facestage.bench.plan_savings import largest_deviation
from facestage.contract.camera import Camera
from facestage.contract.job import FULL, LEAN, Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import OFF, ON, fibonacci_stage
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.plan import Ledger, Plan, Rules, Work
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.unknowns import BLOCKS
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import read_problem
from facestage.fit.result.left_out import amount, left_out, saved_sentence
from facestage.fit.runs.driver import FitRun
from facestage.fit.runs.progress import Progress
from facestage.fit.stages.phases import Schedule
from facestage.fit.trust.fitted import Fitted
from reference.synthetic_case import write_case
from reference.synthetic_scene import Scene, plain_photo

RULES = [rule.name for rule in fields(Rules)]
LIGHTS = 12
# Of a parameter's own standard deviation: what rounding in other orders may do over a few steps.
TOLERANCE = 0.002
# Another program of the renderer rounds on its own at every pixel, which large residuals multiply,
# and rays from skin to skin hit the patch beside: to change the model's picture by 1e-7 of itself
# moves a parameter by 0.0001 or, where a ray goes over to another patch, by 0.03.
TOLERANCE_ELSEWHERE = 0.06
SHORT = Schedule().limited(2)


class Fits:
    """Short fits of a job under given rules, once each."""

    def __init__(self, job: Job, folders: Callable[[], Path]) -> None:
        self.job, self.folders = job, folders
        self.done: dict[tuple[Rules, str], tuple[Fitted, list[Evaluation]]] = {}

    def __call__(self, rules: Rules | None = None, job: Job | None = None) -> Fitted:
        return self.run(rules, job)[0]

    def run(
        self, rules: Rules | None = None, job: Job | None = None
    ) -> tuple[Fitted, list[Evaluation]]:
        """Where the fit ended, and what its first phase with light saw at each step, when no
        surface moved.
        """
        job = self.job if job is None else job
        problem, wanted = read_problem(job), Rules.of(job.plan) if rules is None else rules
        key = (wanted, problem.fingerprint)
        if key not in self.done:
            seen: list[Evaluation] = []

            def listen(progress: Progress) -> None:
                if progress.phase == "light and albedo" and progress.evaluation is not None:
                    seen.append(progress.evaluation)

            forward = ForwardModel(problem.geometry, problem.lights)
            run = FitRun(problem, forward, self.folders(), listen=listen, schedule=SHORT)
            run.view.plan = Plan(wanted)
            self.done[key] = run.run(float("inf")), seen
        return self.done[key]


def left_out_by(rule: str, fits: Fits, rules: Rules) -> float:
    """How much ``rule`` left out in the fit under ``rules``: units of its work, or photos without
    derivatives.
    """
    fitted, seen = fits.run(rules)
    if rule == "terms":
        return sum(not evaluation.image.terms.diffuse_by_normal.any() for evaluation in seen)
    return sum(units for (name, _), units in fitted.ledger.skipped.items() if name == rule)


def without(rule: str) -> Rules:
    return replace(Rules(), **{rule: False})


@pytest.fixture(scope="module")
def job(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Job:
    """Lit from one side, so that lights are fitted to zero; the first is off, the roughness known,
    a mode held.
    """
    radiance = np.where(np.arange(6)[:, None] == 2, scene.lights.radiance(scene.state.lights), 0.0)
    one_sided = replace(
        scene, state=replace(scene.state, lights=scene.lights.from_radiance(radiance))
    )
    case = write_case(tmp_path_factory.mktemp("one-sided"), one_sided)
    stage = fibonacci_stage(LIGHTS)
    stage = replace(stage, state=np.array([OFF] + [ON] * (LIGHTS - 1))).with_radiance(
        stage.radiance
    )
    return Job(
        case.photo,
        case.model_option,
        Landmarks.read(case.landmarks),
        Camera.read(case.camera),
        stage=stage,
        device="cpu",
        freeze=("roughness",),
        initial={"specular": np.full((6, 6), 0.8)},
    )


@pytest.fixture(scope="module")
def fit(job: Job, tmp_path_factory: pytest.TempPathFactory) -> Fits:
    return Fits(job, lambda: tmp_path_factory.mktemp("fit"))


def assert_agree(found: Fitted, wanted: Fitted, tolerance: float = TOLERANCE) -> None:
    worst = largest_deviation(found, wanted)
    print(f"largest difference: {worst:.1e} standard deviations, allowed {tolerance:g}")
    assert worst < tolerance
    np.testing.assert_allclose(
        found.state.model_to_camera, wanted.state.model_to_camera, atol=1e-5 * tolerance / TOLERANCE
    )


@pytest.mark.parametrize("rule", RULES)
def test_the_answer_is_the_same_without_a_rule(fit: Fits, rule: str):
    # The rule was on in one fit and off in the other, and left something out.
    assert left_out_by(rule, fit, Rules()) > 0 == left_out_by(rule, fit, without(rule))
    assert_agree(fit(without(rule)), fit())


def test_the_answer_is_the_same_under_the_full_plan(fit: Fits, job: Job):
    full = fit(None, replace(job, plan=FULL))
    assert_agree(full, fit(), TOLERANCE_ELSEWHERE)
    assert {rule for rule, _ in full.ledger.skipped} <= {"facing", "shadows"}, (
        "nothing is skipped but rays without light, and the motion of shadows, which is no "
        "question of the plan"
    )


def test_a_matte_face_needs_no_specular_terms(fit: Fits, job: Job):
    matte = replace(job, freeze=("roughness", "specular"), initial={"specular": np.zeros((6, 6))})
    lean, full = fit(None, matte), fit(None, replace(matte, plan=FULL))
    assert_agree(lean, full, TOLERANCE_ELSEWHERE)


@pytest.mark.parametrize("rule", RULES)
def test_one_system_is_the_same_without_a_rule(scene: Scene, rule: str):
    """The Hessian and the gradient, to what float32 products keep."""
    photo = scene.render(samples=8)[0]
    layout = Layout(scene.state)
    active = layout.mask(BLOCKS)
    systems = []
    for rules in (Rules(), without(rule)):
        term = scene.photo_term(photo, 4, plan=Plan(rules))
        evaluation = term.evaluate(scene.state, 5)
        weights = term.weights(evaluation, term.noise(evaluation))
        systems.append(term.normal_equations(evaluation, weights, layout, active))
    size = np.sqrt(np.outer(*2 * [np.diag(systems[1][0])])) + 1e-12 * np.diag(systems[1][0]).max()
    assert np.abs((systems[0][0] - systems[1][0]) / size).max() < 1e-5
    root = np.sqrt(np.diag(systems[1][0])) + 1e-9
    assert (
        np.abs((systems[0][1] - systems[1][1]) / root).max()
        < 1e-4 * np.abs(systems[1][1] / root).max()
    )


def test_pixels_without_weight_are_not_lit(scene: Scene):
    photo = plain_photo(scene.render(samples=8)[0])
    skin = photo.skin.copy()
    skin[:, :48] = 0
    photo = replace(photo, skin=skin)
    lean, full = (
        PhotoTerm(scene.forward, photo, scene.stage, 2, plan=Plan(rules))
        for rules in (Rules(), without("pixels"))
    )
    few, many = (term.evaluate(scene.state, 1) for term in (lean, full))
    assert len(few.image.color) == int((few.base_weight > 0).sum()) < 0.7 * len(many.image.color)
    np.testing.assert_array_equal(few.base_weight, many.base_weight)
    counted = few.base_weight > 0
    np.testing.assert_allclose(few.residual[counted], many.residual[counted], rtol=1e-6, atol=1e-9)
    assert lean.plan.ledger.skipped["pixels", "lit"] == len(many.image.color) - len(few.image.color)


def test_a_dark_light_rests_only_while_it_wants_to():
    fitted = np.array([True, True, False, True])
    fixed = np.zeros((4, 3))
    several = LightParameters(fitted, fixed, uniform=False)
    values = np.array([0, 0, 0, 0, 0, 1.0, 0, 0, 0])
    nothing = several.dark(values, np.zeros(9, bool))
    assert nothing.tolist() == [False, False, True, False], (
        "an unlit light that is not fitted is dark"
    )
    settled = np.array([True] * 3 + [True, True, False] + [True, False, True])
    assert several.dark(values, settled).tolist() == [True, False, True, False], (
        "one channel that wants up keeps it on"
    )
    uniform = LightParameters(fitted, fixed, uniform=True)
    values = np.array([0.0, 2.0, 0.0, 1.0, 1.0, 1.0])
    settled = np.array([True, False, False, False, False, False])
    assert uniform.dark(values, settled).tolist() == [True, False, True, False]


def test_a_resting_light_comes_back(scene: Scene):
    """A light that the photo needs is asked in the first step of a phase, and turned on."""
    photo = scene.render(samples=32)[0]
    radiance = scene.lights.radiance(scene.state.lights).copy()
    radiance[0] = 0.0
    start = replace(scene.state, lights=scene.lights.from_radiance(radiance))
    from facestage.contract.job import Weights

    stage = scene.solver(
        photo, ("lights",), 6, Weights(prior=1e-3, light=1e-3, landmarks=1e-3), samples=16
    )
    stage.resting = np.array([True] + [False] * 5)
    found, _ = scene.fit(stage, start)
    np.testing.assert_allclose(found.lights[:3], scene.state.lights[:3], rtol=0.1)


def test_frozen_parameters_and_modes_that_move_nothing_seen_have_no_column(fit: Fits, job: Job):
    """Pixels times parameters, in every step: what the job froze, and what the ledger says beyond
    that.
    """
    thawed = fit(None, replace(job, freeze=()))
    frozen = fit().ledger.skipped["columns", "cells"]
    assert frozen > thawed.ledger.skipped["columns", "cells"] > 0


def test_the_ledger_reckons_with_the_rate_of_its_run():
    ledger = Ledger({"samples": Work(seconds=2.0, units=8e6)})
    ledger.skip("lights", samples=4.1e6)
    ledger.skip("lights", samples=0)
    units, seconds = ledger.saved("lights")["samples"]
    assert units == 4.1e6 and seconds == pytest.approx(1.025)
    sentence, seconds = saved_sentence(ledger, "lights", "samples")
    assert sentence == "4.1 million light samples, about 1 s at this run's 4 million a second"
    assert seconds == pytest.approx(1.025)
    ledger.skip("columns", cells=3e9)
    assert saved_sentence(ledger, "columns", "cells") == (
        "3 billion entries of the Jacobian; not timed, this run never did any",
        None,
    )


def test_work_is_timed_in_every_unit_it_is_counted_in():
    ledger = Ledger()
    with ledger.timed(lit=3) as done:
        done["rays"] = 12
    assert ledger.work["lit"].units == 3 and ledger.work["rays"].units == 12
    assert ledger.work["lit"].seconds == ledger.work["rays"].seconds > 0
    assert ledger.rate("cells") is None


@pytest.mark.parametrize(
    ("count", "words"), [(431, "431"), (27_400, "27 thousand"), (4.13e6, "4.1 million")]
)
def test_amounts_in_words(count: float, words: str):
    assert amount(count) == words


def test_the_result_says_what_was_left_out_and_what_it_saved(fit: Fits, job: Job):
    entries = left_out(read_problem(job), fit())
    by_name = {entry["what"]: entry for entry in entries}
    assert by_name[f"1 of {LIGHTS} lights"]["why"] == "switched off"
    for what in (f"1 of {LIGHTS} lights", "pixels without weight", "columns of the Jacobian"):
        entry = by_name[what]
        assert "at this run's" in entry["saved"] and entry["seconds"] > 0, what
    assert "roughness" in by_name and "focal length" in by_name
    full = replace(job, plan=FULL)
    entries = left_out(read_problem(full), fit(None, full))
    assert entries[0]["what"] == "nothing that the plan knows of"
    assert not any("pixels" in entry["what"] for entry in entries)


def test_plans_turn_all_rules_on_or_off():
    assert all(vars(Rules.of(LEAN)).values()) and not any(vars(Rules.of(FULL)).values())
