"""How much light goes from skin to skin: found in the photo, and left out where there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.fit.face.layout import Layout
from facestage.fit.face.unknowns import INTERREFLECTION_MEAN
from facestage.fit.result.run import fit_job
from facestage.fit.stages.view import INTERREFLECTION_MIN
from reference.skin_strengths import found_in, view_of
from reference.small_fit import QUICK
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene

LITTLE = 0.5 * INTERREFLECTION_MIN


def test_next_to_nothing_is_left_out_and_held(case: Case):
    view = view_of(case.job())
    start = view.start_state()
    assert start.interreflection == INTERREFLECTION_MEAN
    little, none = (replace(start, interreflection=value) for value in (LITTLE, 0.0))
    assert view.without_next_to_nothing(start) is start
    assert view.without_next_to_nothing(little).interreflection == 0
    where = Layout(start).slices["interreflection"]
    assert not view.held(start)[where].any() and view.held(none)[where].all()
    assert not view.held(none)[Layout(none).mask(["albedo", "lights"])].any()


def test_what_the_job_holds_stays(case: Case):
    view = view_of(replace(case.job(), freeze=("interreflection",)))
    little = replace(view.start_state(), interreflection=LITTLE)
    assert view.without_next_to_nothing(little) is little


def test_a_photo_tells_how_much_there_is(scene: Scene, tmp_path: Path):
    """Of a sheet with a nose, which hardly sees itself: none is less than the prior has, and all is
    all.
    """
    none, all_of_it = (
        found_in(scene, tmp_path / str(there), "interreflection", there) for there in (0.0, 1.0)
    )
    assert none < 0.9 * INTERREFLECTION_MEAN
    assert all_of_it == pytest.approx(1.0, abs=0.1)


def test_a_fit_without_it_says_so(case: Case, tmp_path: Path):
    start = {"interreflection": np.array(0.0)}
    result = fit_job(replace(case.job(), initial=start), tmp_path / "out", fineness=QUICK)
    assert result.parameters["interreflection"] == 0
    assert "light from skin to skin" in [entry["what"] for entry in result.left_out]
    assert result.arrays["deviation/interreflection"] == 0
