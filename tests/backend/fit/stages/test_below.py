"""How far light wanders below the skin: found in the photo, and left out where there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.job import Job, Weights
from facestage.fit.face.layout import Layout
from facestage.fit.face.unknowns import BELOW, SKIN
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import read_problem
from facestage.fit.result.run import fit_job
from facestage.fit.stages.below import FIRST_STRENGTH, GAIN_MIN, Below, look_below
from facestage.fit.stages.phases import Phase, PhaseName, default_schedule
from facestage.fit.stages.view import View
from reference.small_fit import QUICK
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene

# A sheet of pixels of 3 mm: skin of which light wanders far.
FAR = 3.0


def view_of(job: Job) -> View:
    problem = read_problem(job, fineness=QUICK)
    return View(problem, ForwardModel(problem.geometry, problem.lights))


def lit(view: View) -> tuple[Phase, ...]:
    return default_schedule(view.problem.job).photo_phases


def test_it_is_looked_for_in_the_last_phase_alone(case: Case):
    view = view_of(case.job())
    start = view.start_state()
    *coarse, last = lit(view)
    assert last.name == PhaseName.JOINT and start.scattering == 0
    state = view.with_initial_lights(last, start)
    for phase in coarse:
        assert view.with_scattering(phase, state) is state
    assert view.below is None
    view.with_scattering(last, state)
    assert view.below is not None


def test_what_gains_little_is_left_out_and_held(case: Case, monkeypatch: pytest.MonkeyPatch):
    view = view_of(case.job())
    last = lit(view)[-1]
    state = view.with_initial_lights(last, view.start_state())
    where = Layout(state).slices["scattering"]
    for gain, joined in ((GAIN_MIN - 0.1, False), (GAIN_MIN, True)):
        monkeypatch.setattr(
            "facestage.fit.stages.view.look_below", lambda *_, gain=gain: Below(gain)
        )
        found = view.with_scattering(last, state)
        assert found.scattering == (FIRST_STRENGTH if joined else 0)
        assert view.held(found)[where].all() == (not joined)
    assert f"{GAIN_MIN:g}" in Below(1.0).words and "raises" in Below(-1.0).words


@pytest.mark.parametrize("given", [0.0, 0.8])
def test_what_the_job_holds_stays(case: Case, given: float):
    initial = {"scattering": np.array(given)} if given else {}
    view = view_of(replace(case.job(), freeze=BELOW, initial=initial))
    last = lit(view)[-1]
    state = view.with_initial_lights(last, view.start_state())
    assert view.with_scattering(last, state) is state and state.scattering == given
    assert view.held(state)[Layout(state).slices["scattering"]].all()


def photo_of(scene: Scene, there: float) -> np.ndarray:
    return scene.render(replace(scene.state, scattering=there))[0]


@pytest.mark.parametrize("there", [0.0, FAR])
def test_a_photo_tells_whether_there_is_any(scene: Scene, there: float):
    photo = photo_of(scene, there)
    noisy = photo + 0.01 * photo.mean() * np.random.default_rng(0).normal(size=photo.shape)
    found = look_below(scene.photo_term(noisy, samples=32), scene.state, seed=5)
    print(f"with {there:g}: {found}")
    assert found.joined == (there > 0)


def test_how_far_it_goes_is_found(scene: Scene):
    """Beside lights and albedo, which explain the rest."""
    start = replace(scene.state, scattering=FIRST_STRENGTH, albedo=0.8 * scene.state.albedo)
    blocks = (*BELOW, *SKIN)
    stage = scene.solver(photo_of(scene, 2.0), blocks, 20, Weights(), samples=64)
    state, _ = scene.fit(stage, start)
    print(f"found {state.scattering:.2f} of 2")
    assert state.scattering == pytest.approx(2.0, abs=0.4)


def test_a_fit_without_it_says_so(case: Case, tmp_path: Path):
    result = fit_job(case.job(), tmp_path / "out", fineness=QUICK)
    assert result.parameters["scattering"] == 0
    reasons = {entry["what"]: entry["why"] for entry in result.left_out}
    assert "energy" in reasons["light below the skin"]
    assert result.arrays["deviation/scattering"] == 0
