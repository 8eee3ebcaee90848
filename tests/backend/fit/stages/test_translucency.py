"""How unevenly light comes out of the skin: found in the photo, and left out where it does not."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.fit.face.layout import Layout
from facestage.fit.face.unknowns import TRANSLUCENCY_MEAN
from facestage.fit.result.run import fit_job
from facestage.fit.stages.view import TRANSLUCENCY_MIN
from reference.skin_strengths import found_in, view_of
from reference.small_fit import QUICK
from reference.synthetic_case import Case
from reference.synthetic_scene import Scene

LITTLE = 0.5 * TRANSLUCENCY_MIN


def test_next_to_nothing_is_left_out_and_held(case: Case):
    view = view_of(case.job())
    start = view.start_state()
    assert start.translucency == TRANSLUCENCY_MEAN
    little, none = (replace(start, translucency=value) for value in (LITTLE, 0.0))
    assert view.without_next_to_nothing(start) is start
    assert view.without_next_to_nothing(little).translucency == 0
    where = Layout(start).slices["translucency"]
    assert not view.held(start)[where].any() and view.held(none)[where].all()
    frozen = view_of(replace(case.job(), freeze=("translucency",)))
    assert frozen.without_next_to_nothing(little) is little


def test_a_photo_tells_how_much_there_is(scene: Scene, tmp_path: Path):
    none, all_of_it = (
        found_in(scene, tmp_path / str(there), "translucency", there) for there in (0.0, 1.0)
    )
    print(f"found {none:.2f} of 0, {all_of_it:.2f} of 1")
    assert none < 0.3 < 0.7 < all_of_it < 1.3


def test_a_fit_without_it_says_so(case: Case, tmp_path: Path):
    start = {"translucency": np.array(0.0)}
    result = fit_job(replace(case.job(), initial=start), tmp_path / "out", fineness=QUICK)
    assert result.parameters["translucency"] == 0
    assert "light that comes out of the skin unevenly" in [
        entry["what"] for entry in result.left_out
    ]
    assert result.arrays["deviation/translucency"] == 0
