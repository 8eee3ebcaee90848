"""Lights that are known but for the photo's exposure become as bright as the photo says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.job import Job
from facestage.contract.light_stage import FROZEN, LightStage, fibonacci_stage
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import read_problem
from facestage.fit.result.run import fit_job
from facestage.fit.runs.checkpoint import Checkpoint
from facestage.fit.runs.driver import FitRun
from facestage.fit.trust.fitted import Fitted
from reference.known import known
from reference.small_fit import QUICK, StopError
from reference.synthetic_case import Case
from reference.synthetic_scene import RADIANCE

FOREVER = float("inf")


def stage(level: float) -> LightStage:
    """The lights of the photo, ``level`` times as bright, held."""
    lights = fibonacci_stage(len(RADIANCE), radius=0.8).with_radiance(level * RADIANCE)
    return replace(lights, state=np.full(len(lights), FROZEN))


def job(case: Case, level: float, exposure: str = "unknown") -> Job:
    return case.job(stage=stage(level), exposure=exposure, truth=None)


def run_of(wanted: Job, folder: Path) -> FitRun:
    folder.mkdir(exist_ok=True)
    problem = read_problem(wanted, fineness=QUICK)
    return FitRun(problem, ForwardModel(problem.geometry, problem.lights), folder)


@pytest.fixture(scope="module")
def bright(case: Case, tmp_path_factory: pytest.TempPathFactory) -> Fitted:
    return run_of(job(case, 30.0), tmp_path_factory.mktemp("bright")).run(FOREVER)


def test_the_level_does_not_matter(case: Case, bright: Fitted, tmp_path: Path):
    dark = run_of(job(case, 0.02), tmp_path).run(FOREVER)
    np.testing.assert_allclose(dark.stage.radiance, bright.stage.radiance, rtol=1e-5)
    share = bright.stage.radiance / RADIANCE
    np.testing.assert_allclose(share, share[0, 0], rtol=1e-9, err_msg="but for one factor, known")
    assert bright.trace[-1]["psnr"] > 28


def test_the_result_says_so(case: Case, tmp_path: Path):
    result = fit_job(job(case, 30.0), tmp_path / "out", fineness=QUICK)
    (factor,) = set((result.stage.radiance / (30.0 * RADIANCE)).ravel().round(9))
    assert result.photo["light"].startswith(f"held lights {factor:.3g} times as bright as given")


def test_what_is_known_stays(case: Case, tmp_path: Path):
    fitted = run_of(job(case, 30.0, "known"), tmp_path).run(FOREVER)
    np.testing.assert_allclose(fitted.stage.radiance, 30.0 * RADIANCE)


def test_lights_that_are_fitted_need_no_exposure(case: Case, tmp_path: Path):
    run = run_of(case.job(exposure="unknown", truth=None), tmp_path)
    run.run(FOREVER)
    assert run.view.problem.exposure == 1.0


def test_stopped_and_resumed_it_ends_at_the_same_place(case: Case, bright: Fitted, tmp_path: Path):
    run = run_of(job(case, 30.0), tmp_path)

    def listen(_progress: object) -> None:
        if len(run.trace) == len(bright.trace) - 2:
            raise StopError

    run.listen = listen
    with pytest.raises(StopError):
        run.run(FOREVER)
    checkpoint = known(Checkpoint.load(tmp_path))
    found = run_of(job(case, 30.0), tmp_path).run(FOREVER, checkpoint)
    np.testing.assert_array_equal(found.stage.radiance, bright.stage.radiance)
    assert found.energy == bright.energy
