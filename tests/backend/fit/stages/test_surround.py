"""Lights behind the face join where a photo shows light from there, and nowhere else."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.job import Job
from facestage.contract.light_stage import FROZEN, ON, fibonacci_stage, joined, lights_behind
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import read_problem
from facestage.fit.result.left_out import left_out
from facestage.fit.runs.checkpoint import Checkpoint
from facestage.fit.runs.driver import FitRun
from facestage.fit.stages.passage import walk
from facestage.fit.stages.phases import PhaseName, Schedule
from facestage.fit.stages.surround import GAIN_MIN, Surround
from facestage.fit.stages.view import View
from facestage.fit.trust.fitted import Fitted
from reference.known import known
from reference.small_fit import QUICK, StopError
from reference.synthetic_case import Case, write_case
from reference.synthetic_scene import Scene

FOREVER = float("inf")
LIGHTS = 12


def photographed(scene: Scene, folder: Path, from_behind: float) -> Case:
    """The scene's person under six lights in front, and one beside and behind the head."""
    behind = fibonacci_stage(LIGHTS, radius=0.8, behind=True)
    rim = int(np.argmin(np.abs(behind.position[:, 2] + 0.35)))
    lamps = np.zeros((LIGHTS, 3))
    lamps[rim] = from_behind
    matrix = np.eye(4)
    matrix[:3, 3] = scene.state.translation
    stage = joined(scene.stage, behind.transformed(matrix).with_radiance(lamps))
    lights = LightParameters(np.ones(len(stage), bool), np.zeros((len(stage), 3)), uniform=False)
    state = replace(
        scene.state,
        lights=lights.from_radiance(stage.radiance),
        light_position=np.zeros((len(stage), 2)),
    )
    forward = ForwardModel(scene.geometry, lights)
    lit = replace(scene, lights=lights, stage=stage, state=state, forward=forward)
    folder.mkdir(exist_ok=True)
    return write_case(folder, lit)


@pytest.fixture(scope="module")
def rim(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Case:
    """A photo with strong light from behind."""
    return photographed(scene, tmp_path_factory.mktemp("rim"), 120.0)


@pytest.fixture(scope="module")
def front(scene: Scene, tmp_path_factory: pytest.TempPathFactory) -> Case:
    """The same photo without."""
    return photographed(scene, tmp_path_factory.mktemp("front"), 0.0)


def seen(job: Job) -> View:
    """The job's photo when its first light is looked for."""
    problem = read_problem(job, fineness=QUICK)
    view, schedule = View(problem, ForwardModel(problem.geometry, problem.lights)), Schedule()
    state = walk(view, schedule.landmark_phases, view.start_state())
    return view.with_surround(schedule[PhaseName.LIGHT], state)


def run_of(job: Job, folder: Path) -> FitRun:
    problem = read_problem(job, fineness=QUICK)
    folder.mkdir(exist_ok=True)
    return FitRun(problem, ForwardModel(problem.geometry, problem.lights), folder)


def test_light_from_behind_is_found_and_no_other(rim: Case, front: Case):
    lit, plain = (seen(case.job(LIGHTS)) for case in (rim, front))
    found, not_found = known(lit.surround), known(plain.surround)
    print(f"gain {found.gain:.1f} with a rim, {not_found.gain:.1f} without")
    assert found.joined and found.gain > 1.5 * GAIN_MIN and found.share > 0.03
    assert not not_found.joined and not_found.gain < 0.5 * GAIN_MIN
    assert len(lit.problem.stage) == LIGHTS + len(found.lights) == LIGHTS + lit.problem.added
    assert (lit.problem.stage.position[LIGHTS:, 2] < 0).all()
    assert len(plain.problem.stage) == LIGHTS and plain.problem.added == 0


@pytest.mark.parametrize(("surround", "joins"), [("on", True), ("off", False)])
def test_the_job_may_say_so_itself(rim: Case, front: Case, surround: str, joins: bool):
    for case in (rim, front):
        assert bool(seen(case.job(LIGHTS, surround=surround)).problem.added) is joins


def test_nobody_looks_where_no_light_can_join(rim: Case):
    stage = fibonacci_stage(LIGHTS)
    around = joined(stage, known(lights_behind(stage)))
    held = replace(stage, state=np.where(np.arange(LIGHTS) == 2, FROZEN, ON))
    for change in ({"freeze": ("lights",)}, {"stage": around}, {"stage": held}):
        view = seen(rim.job(LIGHTS, **change))
        assert view.surround is None and view.problem.added == 0
    assert seen(rim.job(stage=held, surround="on")).problem.added


def test_lights_that_join_do_not_make_it_another_job(rim: Case):
    given = read_problem(rim.job(LIGHTS), fineness=QUICK)
    lit = seen(rim.job(LIGHTS)).problem
    assert lit.added and lit.fingerprint == given.fingerprint
    other = read_problem(rim.job(LIGHTS, surround="off"), fineness=QUICK)
    assert other.fingerprint != given.fingerprint


@pytest.fixture(scope="module")
def whole(rim: Case, tmp_path_factory: pytest.TempPathFactory) -> tuple[FitRun, Fitted]:
    """A fit with light from behind."""
    run = run_of(rim.job(LIGHTS, truth=None), tmp_path_factory.mktemp("whole"))
    return run, run.run(FOREVER)


def test_the_fit_lights_the_face_from_behind(whole: tuple[FitRun, Fitted]):
    run, fitted = whole
    behind = fitted.stage.radiance[LIGHTS:]
    assert len(behind) == run.view.problem.added > 0
    assert behind.max() > fitted.stage.radiance[:LIGHTS].mean()
    assert not any(
        "behind the face" in entry["what"] for entry in left_out(run.view.problem, fitted)
    )


def test_stopped_and_resumed_it_ends_at_the_same_place(
    rim: Case, whole: tuple[FitRun, Fitted], tmp_path: Path
):
    run, steps = run_of(rim.job(LIGHTS, truth=None), tmp_path), len(whole[1].trace) - 2

    def listen(_progress: object) -> None:
        if len(run.trace) == steps:
            raise StopError

    run.listen = listen
    with pytest.raises(StopError):
        run.run(FOREVER)
    checkpoint = known(Checkpoint.load(tmp_path))
    assert known(checkpoint.memory.surround).joined
    found = run_of(rim.job(LIGHTS, truth=None), tmp_path).run(FOREVER, checkpoint)
    np.testing.assert_array_equal(found.stage.radiance, whole[1].stage.radiance)
    assert found.energy == whole[1].energy and found.surround == whole[1].surround


def test_the_result_says_why_lights_were_left_out(front: Case, tmp_path: Path):
    run = run_of(front.job(LIGHTS, truth=None), tmp_path)
    fitted = run.run(FOREVER)
    found = known(fitted.surround)
    entries = left_out(run.view.problem, fitted)
    (entry,) = (one for one in entries if "behind the face" in one["what"])
    assert entry["what"] == f"{len(found.lights)} lights behind the face"
    assert f"by {found.gain:.1f}, from {GAIN_MIN:g}" in entry["why"] and entry["seconds"] > 0


def test_words():
    assert "the job asks" in Surround((3,), 1.0, 0.1, joined=True).words
    assert "the job asks" in Surround((3,), 2 * GAIN_MIN, 0.1, joined=False).words
    for joins, gain in ((True, GAIN_MIN), (False, GAIN_MIN - 1)):
        words = Surround((3,), gain, 0.25, joins).words
        assert "the job asks" not in words and "25% of the light" in words
