"""Photos of one person at their own sizes: small ones are read once, with the same answers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.forward.shading import ForwardModel
from facestage.fit.result.person_photos import OwnSizes, read_photos
from facestage.fit.runs.joint_run import JointRun
from facestage.fit.runs.member import Member
from facestage.fit.stages.phases import Schedule
from facestage.fit.trust.fitted import Fitted
from reference.small_fit import QUICK
from reference.synthetic_case import Case, write_case
from reference.synthetic_scene import Scene
from reference.two_photos import another_photo

# Faces are smaller than in the photos while they are fitted.
SMALLER = replace(QUICK, joint_face_px=24.0)

Fits = list[tuple[Member, Fitted]]


@pytest.fixture(scope="module")
def fits(case: Case, scene: Scene, renderer: str, tmp_path_factory: pytest.TempPathFactory) -> Fits:
    """Two photos of 96 and of 80 pixels, by their landmarks."""
    folder = tmp_path_factory.mktemp("photos")
    cases = case, write_case(folder, another_photo(scene))
    jobs = [one.job(model=case.model_option) for one in cases]
    problems = read_photos(jobs, lambda event: None, None, SMALLER)
    forwards = [ForwardModel(problem.geometry, problem.lights) for problem in problems]
    schedule = Schedule()
    schedule = schedule.until(schedule.photo_phases[0].name)
    run = JointRun(problems, forwards, folder, [None, None], schedule=schedule)
    return list(zip(run.members, run.run(np.inf).photos, strict=True))


def test_photos_come_back_at_their_own_sizes(fits: Fits):
    sizes = OwnSizes()
    for (member, fitted), width in zip(fits, (96, 80), strict=True):
        problem, one = sizes.of(member, fitted)
        assert member.problem.camera.width < problem.camera.width == width
        assert one.state.camera.width == width and one.hidden.shape[1] == width
        ratio = width / member.problem.camera.width
        small = fitted.state.camera.focal_px
        assert one.state.camera.focal_px == pytest.approx(ratio * small, rel=0.02)


def test_what_is_kept_is_what_would_be_read_again(fits: Fits):
    (first, fitted), (second, other) = fits
    pixels = OwnSizes().of(first, fitted)[0].photograph.mask.size
    sizes = OwnSizes(kept_pixels=pixels)
    kept, of_both = sizes.of(first, fitted)
    again, of_both_again = sizes.of(first, fitted)
    assert again is kept
    np.testing.assert_array_equal(of_both.hidden, of_both_again.hidden)
    read = OwnSizes(kept_pixels=0).of(first, fitted)[0]
    np.testing.assert_array_equal(read.skin, kept.skin)
    np.testing.assert_array_equal(read.photograph.color, kept.photograph.color)
    assert sizes.of(second, other)[0].camera.width == 80, "each photo has its own"
    assert sizes.of(second, other)[0] is not sizes.of(second, other)[0], "memory is bounded"
