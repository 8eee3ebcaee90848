"""How much light goes from skin to skin: found in the photo, and left out where there is none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.job import Weights
from facestage.fit.face.layout import Layout
from facestage.fit.face.unknowns import INTERREFLECTION_MEAN, INTERREFLECTION_SIGMA, SHAPE, SKIN
from facestage.fit.result.run import fit_job
from facestage.fit.stages.phases import Phase, PhaseName, default_schedule
from facestage.fit.stages.skin_to_skin import GAIN_MIN, LOSS_MIN, SkinToSkin, look_between
from facestage.fit.stages.view import INTERREFLECTION_MIN, View
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


def phase_of(view: View, name: str) -> Phase:
    return default_schedule(view.problem.job)[name]


def test_it_is_looked_for_once_the_shape_is_there(case: Case, monkeypatch: pytest.MonkeyPatch):
    view = view_of(case.job())
    specular = phase_of(view, PhaseName.SPECULAR)
    state = view.with_initial_lights(specular, view.start_state())
    for phase in default_schedule(view.problem.job).photo_phases:
        if phase != specular:
            assert view.without_unseen_bounces(phase, state) is state
    assert view.between is None
    for shown in (SkinToSkin(0.1, 0.2), SkinToSkin(0.4, 0.1)):
        monkeypatch.setattr("facestage.fit.stages.view.look_between", lambda *_, shown=shown: shown)
        found = view.without_unseen_bounces(specular, state)
        assert found.interreflection == (state.interreflection if shown.joined else 0)
        assert view.between is view.memory.between is shown
    for state_held in (replace(state, interreflection=0.0), state):
        held = view_of(replace(case.job(), freeze=("interreflection",)))
        assert held.without_unseen_bounces(specular, state_held) is state_held
        assert held.between is None


def test_what_is_clearly_nearer_to_none_is_left_out():
    some = 0.1 * (2 * GAIN_MIN) ** 0.5
    none = 0.5 * (1 - 2 * LOSS_MIN * 0.2**2)
    for strength, by, joined in (
        (0.99 * some, 0.1, False),
        (1.01 * some, 0.1, True),
        (none - 0.01, 0.2, False),
        (none + 0.01, 0.2, True),
        (-1.0, 0.2, False),
        (0.12, 0.21, False),
        (-0.51, 0.48, True),  # a portrait
        (0.1, 0.8, True),  # the photo does not say
        (1.0, float("inf"), True),
    ):
        assert SkinToSkin(strength, by).joined == joined, (strength, by)
    # By the energy's parabola itself.
    shown = SkinToSkin(0.3, 0.1)
    at_none, at_all = (0.5 * ((each - 0.3) / 0.1) ** 2 for each in (0, 1))
    assert shown.gain == pytest.approx(at_none)
    assert shown.loss == pytest.approx(at_all - at_none)
    assert SkinToSkin(-1.0, 0.1).gain == 0
    assert "0.10 ± 0.20 of it: all of it would raise the energy by 10.0, none raises it by 0.1" in (
        SkinToSkin(0.1, 0.2).words
    )


@pytest.mark.parametrize("there", [0.2, 0.9])
def test_the_photo_alone_is_asked(scene: Scene, there: float):
    """Of the quadratic model without the prior of the strength, solved as it stands."""
    photo = scene.render(replace(scene.state, interreflection=there), samples=64)[0]
    noisy = photo + 0.01 * photo.mean() * np.random.default_rng(0).normal(size=photo.shape)
    descent = scene.solver(noisy, (*SHAPE, *SKIN), 1, Weights(), samples=16)
    start = replace(scene.state, interreflection=0.6)
    found = look_between(descent, start, 5)

    system = descent.system(start, descent.evaluate(start, 5, everything=True))
    values, gradient = descent.values(start), system.gradient.copy()
    where = descent.energy.layout.slices["interreflection"].start
    hessian = system.hessian.copy()
    hessian[where, where] -= INTERREFLECTION_SIGMA**-2
    gradient[where] -= (0.6 - INTERREFLECTION_MEAN) / INTERREFLECTION_SIGMA**2
    stuck = (values <= descent.low) & (system.gradient > 0)
    free = np.flatnonzero(descent.active & ~stuck & (np.diag(hessian) > 0))
    scale = np.diag(hessian)[free] ** -0.5
    inverse = np.linalg.inv(hessian[np.ix_(free, free)] * scale[:, None] * scale) * scale
    inverse *= scale[:, None]
    row = inverse[np.flatnonzero(free == where)[0]]
    strength = 0.6 - row @ gradient[free]
    print(f"{there:g} there: {found}")
    assert found.strength == pytest.approx(strength, abs=1e-4)
    assert found.deviation == pytest.approx(row[free == where][0] ** 0.5, rel=1e-4)
    assert found.strength == pytest.approx(there, abs=0.25)


def test_a_fit_says_what_the_photo_shows_of_it(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    none = SkinToSkin(0.1, 0.2)
    monkeypatch.setattr("facestage.fit.stages.view.look_between", lambda *_: none)
    result = fit_job(case.job(), tmp_path / "out", fineness=QUICK)
    reasons = {entry["what"]: entry["why"] for entry in result.left_out}
    assert result.parameters["interreflection"] == 0
    assert reasons["light from skin to skin"] == none.words
