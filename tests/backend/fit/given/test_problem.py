"""What a fit is given: where it starts, and what it may paint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.job import Job
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given import problem as problem_module
from facestage.fit.given.beard import Beard
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


def test_a_beard_is_painted_whatever_reaches_it_and_glasses_before_it_are_not(
    case: Case, monkeypatch: pytest.MonkeyPatch
):
    """Hair that hangs down to it, or the dark of a neck, is one region with it."""
    plain = read_problem(case.job(), fineness=QUICK)
    shape = plain.paintable.shape
    columns = np.broadcast_to(np.arange(shape[1]), shape)
    covers, frame = columns % 8 < 3, columns % 8 == 2
    assert (plain.paintable[covers] < 1).any() and not plain.beard.covers.any()
    monkeypatch.setattr(problem_module, "beard_of", lambda *_: Beard(np.zeros(shape), covers))
    monkeypatch.setattr(problem_module, "spectacle_frame", lambda *_: frame)
    bearded = read_problem(case.job(), fineness=QUICK)
    expected = np.where(frame, 0.0, np.where(covers, 1.0, plain.paintable))
    np.testing.assert_array_equal(bearded.paintable, expected)


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
