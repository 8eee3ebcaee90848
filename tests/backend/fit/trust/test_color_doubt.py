"""How well a fit says it knows the skin's color, and what a white balance does to it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.job import Job
from facestage.contract.result import Result
from facestage.fit.face.layout import Layout
from facestage.fit.given.problem import read_problem
from facestage.fit.result.run import fit_job
from facestage.fit.trust import advice
from facestage.fit.trust.color_doubt import color_doubt
from reference.known import known
from reference.small_fit import QUICK
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene

COOL = (0.8, 1.0, 1.2)


def test_both_deviations_are_those_of_drawn_states(scene: Scene):
    state, lights, geometry = scene.state, scene.lights, scene.forward.geometry
    layout, random = Layout(state), np.random.default_rng(0)
    covariance = np.zeros((layout.size, layout.size))
    drawn = {}
    for name in ("lights", "albedo"):
        where = layout.slices[name]
        size = where.stop - where.start
        root = 1e-3 * random.normal(size=(size, size))
        covariance[where, where] = root @ root.T
        drawn[name] = random.normal(size=(20_000, size)) @ root.T
    light = lights.radiance(state.lights).sum(0) + drawn["lights"].reshape(20_000, -1, 3).sum(1)
    region = geometry.model.regions["narrow_face"]
    skin = drawn["albedo"] @ geometry.model.albedo_basis[:, region].mean(axis=1)
    found = known(color_doubt(geometry, lights, state, covariance))
    assert found.light == pytest.approx(np.log(light[:, 0] / light[:, 2]).std(), rel=0.03)
    assert found.skin == pytest.approx((skin[:, 0] - skin[:, 2]).std(), rel=0.03)

    albedo = layout.slices["albedo"].start + 3  # the first of those that are not grey
    covariance[albedo, albedo] = np.inf
    assert known(color_doubt(geometry, lights, state, covariance)).skin == np.inf
    covariance[layout.slices["albedo"], :] = 0
    assert color_doubt(geometry, lights, state, covariance) is None, "the skin is held"


@pytest.fixture
def job(case: Case, scene: Scene, tmp_path: Path) -> Job:
    """Of a face whose skin may be redder or bluer all over."""
    model = scene.model
    redder = 0.15 * np.ones((1, len(model.vertices), 3)) * [1, 0, -1]
    basis = np.concatenate([model.albedo_basis, redder]).astype(np.float32)
    replace(model, albedo_basis=basis).save(tmp_path / "model.npz")
    model_file = f"npz:{tmp_path / 'model.npz'}"
    return case.job(lights=6, model=model_file, light_color="uniform")


def red_over_blue(result: Result) -> float:
    total = result.stage.radiance.sum(axis=0)
    return float(np.log(total[0] / total[2]))


@pytest.mark.usefixtures("renderer")
def test_a_white_balance_moves_the_light_and_ends_the_doubt(
    job: Job, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(advice, "COLOR_MENTIONED", 0.0)
    guessed = fit_job(job, tmp_path / "guessed", fineness=QUICK)
    told = fit_job(replace(job, white_balance=COOL), tmp_path / "told", fineness=QUICK)
    wanted = np.log(COOL[0] / COOL[2])
    assert abs(red_over_blue(told) - wanted) < 0.3 * abs(red_over_blue(guessed) - wanted)
    before, after = (one.errors["skin_color_deviation"] for one in (guessed, told))
    assert 0 < after < 0.8 * before
    assert f"and the skin's to {before:.0%}, so" in guessed.advice
    assert "--white-balance" in guessed.advice and "--white-balance" not in told.advice
    assert "grey is 0.80, 1.00, 1.20" in told.photo["light"] and "light" not in guessed.photo


def test_a_pixel_is_read_from_the_photo(job: Job, case: Case):
    problem = read_problem(replace(job, white_balance=(48.0, 50.5)))
    color = problem.photograph.color[48:53, 46:51].mean(axis=(0, 1))
    np.testing.assert_allclose(known(problem.grey), color, rtol=1e-6)
    assert read_problem(job).grey is None
    given = read_problem(replace(job, white_balance=COOL))
    np.testing.assert_array_equal(known(given.grey), COOL)
    assert len({one.fingerprint for one in (problem, given, read_problem(job))}) == 3
    with pytest.raises(InputError, match="black in some channel"):
        read_problem(replace(job, white_balance=(1.0, 1.0)))


def test_where_all_light_is_held_there_is_nothing_to_balance(job: Job):
    with pytest.raises(InputError, match="holds all lights"):
        read_problem(replace(job, white_balance=COOL, freeze=("lights",)))
