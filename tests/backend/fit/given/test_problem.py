"""A fit that starts at a focal length of the job's."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.job import Job
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import read_problem
from facestage.fit.given.window import Window
from facestage.fit.stages.view import View
from reference.small_fit import QUICK
from reference.synthetic_case import Case

FOCAL = np.array(170.0)


@pytest.fixture
def job(case: Case) -> Job:
    return replace(case.job(), camera=None, initial={"focal_px": FOCAL})


def test_the_fit_starts_at_it_and_believes_in_the_usual_one(job: Job):
    problem = read_problem(job, fineness=QUICK)
    start = View(problem, ForwardModel(problem.geometry, problem.lights)).start_state()
    usual = read_problem(replace(job, initial={}), fineness=QUICK)
    assert start.camera.focal_px == pytest.approx(float(FOCAL))
    assert problem.camera == usual.camera == usual.start_camera
    assert problem.camera.focal_px != pytest.approx(float(FOCAL))


def test_it_is_given_in_pixels_of_the_whole_photo(job: Job):
    problem = read_problem(job, fineness=QUICK)
    width, height = problem.window.full
    part = replace(problem, window=Window((width, height), (4, 4, width, height), 0.5))
    assert part.start_camera.focal_px == pytest.approx(0.5 * float(FOCAL))


def test_what_cannot_be_is_refused(job: Job, case: Case):
    for other, sentence in (
        (replace(job, camera=case.job().camera), "holds the focal length"),
        (replace(job, freeze=("focal",)), "holds the focal length"),
        (replace(job, initial={"focal_px": np.array(-3.0)}), "expected a positive number"),
        (replace(job, initial={"focal_px": np.ones(2)}), "has shape"),
    ):
        with pytest.raises(InputError, match=sentence):
            read_problem(other, fineness=QUICK)
