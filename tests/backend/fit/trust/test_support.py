"""What the photo adds to the landmarks: against deviations of vertices, and in whole fits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.job import Job, Weights
from facestage.contract.result import CONVERGED
from facestage.fit.result.run import fit_job
from facestage.fit.trust.support import Support, expected_distance
from facestage.fit.trust.vertex_certainty import vertex_deviation
from reference.small_fit import QUICK
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene


def test_the_expected_distance_is_that_of_the_vertices_deviations(scene: Scene):
    model, state = scene.model, scene.state
    root = 0.05 * np.random.default_rng(1).normal(size=(7, 7))
    root[2] = 0  # as if it were held
    region = model.regions["narrow_face"]
    shape = model.shape(state.identity, state.expression).astype(float)
    known = vertex_deviation(model, shape, state.rotation, root @ root.T, region)[region]
    found = expected_distance(model, shape, region, root @ root.T)
    assert found == pytest.approx(float(np.sqrt((known**2).sum(axis=1).mean())), rel=1e-4)
    assert found > 0.1
    unknown = root @ root.T + np.diag([0, 0, np.inf, 0, 0, 0, 0])
    assert expected_distance(model, shape, region, unknown) == pytest.approx(found)


@pytest.mark.parametrize(("photo", "little"), [(1.0, True), (0.81, True), (0.79, False)])
def test_a_fifth_less_is_worth_a_word(photo: float, little: bool):
    assert Support(3.0, 3.0 * photo).little is little


@pytest.mark.parametrize(("photo", "weak"), [(0.41, True), (0.39, False)])
def test_what_may_be_misfit_is_not_relied_on(photo: float, weak: bool):
    assert Support(3.0, 3.0 * photo).weak is weak


@pytest.fixture
def job(case: Case) -> Job:
    return case.job(lights=6)


@pytest.mark.usefixtures("renderer")
def test_a_photo_that_tells_nothing_of_the_shape_is_said_to(job: Job, tmp_path: Path):
    told = fit_job(job, tmp_path / "told", fineness=QUICK)
    assert told.errors["shape_deviation"] < 0.8 * told.errors["landmark_shape_deviation"]
    assert told.status == CONVERGED and "hardly adds" not in told.advice
    share = told.errors["shape_deviation"] / told.errors["landmark_shape_deviation"]
    assert ("no better than by landmarks alone" in told.advice) is (share > 0.4)
    # Landmarks that leave nothing to tell.
    deaf = replace(job, weights=Weights(landmarks=300))
    silent = fit_job(deaf, tmp_path / "silent", fineness=QUICK)
    assert silent.errors["shape_deviation"] == pytest.approx(
        silent.errors["landmark_shape_deviation"], rel=0.2
    )
    assert "the photo hardly adds to what the landmarks tell" in silent.advice
    assert silent.advice.count("\n") == 0 and silent.advice.endswith("of the person together.")


@pytest.mark.usefixtures("renderer")
def test_where_no_shape_is_fitted_nothing_is_said_of_it(job: Job, tmp_path: Path):
    held = replace(job, freeze=("identity", "expression"))
    assert "shape_deviation" not in fit_job(held, tmp_path / "held", fineness=QUICK).errors
