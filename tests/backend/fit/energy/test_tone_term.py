"""Nobody's skin is lighter than the lightest people's, nor darker than the darkest's."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from facestage.contract.files.color import REC709
from facestage.fit.energy.tone_term import SIGMA, Tone, ToneTerm, tone_of
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.models.anatomy.skin import HAEMOGLOBIN_MEAN, skin_albedo
from facestage.models.registry import load_model
from facestage.stress.scene import plain_scene


@cache
def geometry() -> FaceGeometry:
    return FaceGeometry(load_model("default"))


def skin(state: State) -> float:
    """The mean log albedo of what is compared with photos, by the model's own sum."""
    log_albedo = geometry().log_albedo + np.tensordot(state.albedo, geometry().albedo_basis, 1)
    return float((log_albedo[geometry().fitted_vertices] @ np.array(REC709)).mean())


@pytest.fixture
def start() -> State:
    state = plain_scene(geometry().model, seed=1, side_px=64).state
    return replace(state, albedo=0 * state.albedo)


def toned(state: State, coefficient: float) -> State:
    """Lighter for a negative ``coefficient``, which is the first tone's."""
    return replace(state, albedo=np.eye(len(state.albedo))[0] * coefficient)


@pytest.mark.parametrize("melanin", [0.012, 0.035, 0.10, 0.30])
def test_people_are_not_beyond_the_limits(start: State, melanin: float):
    tone = tone_of(geometry())
    mean = skin_albedo(np.array([0.035]), np.array([HAEMOGLOBIN_MEAN]))
    change = np.log(skin_albedo(np.array([melanin]), np.array([HAEMOGLOBIN_MEAN])) / mean)
    person = replace(tone, mean=tone.mean + float((change @ np.array(REC709))[0]))
    assert person.residuals(start)[0] == 0.0


@pytest.mark.parametrize(("coefficient", "sign"), [(-1.0, 1.0), (4.0, -1.0)])
def test_beyond_them_it_costs_how_far(start: State, coefficient: float, sign: float):
    tone, state = tone_of(geometry()), toned(start, coefficient)
    limit = tone.limits[1] if sign > 0 else tone.limits[0]
    (residual,) = tone.residuals(state)
    assert sign * residual > 1.0
    np.testing.assert_allclose(residual, (skin(state) - limit) / SIGMA, rtol=1e-4)


@pytest.mark.parametrize("coefficient", [-1.0, 0.0, 4.0])
def test_the_slope_is_that_of_the_residual(start: State, coefficient: float):
    tone, state = tone_of(geometry()), toned(start, coefficient)
    layout = Layout(state)
    direction = np.random.default_rng(0).normal(size=layout.size)
    slope = tone.jacobian(state, layout) @ direction
    plus, minus = (tone.residuals(layout.apply(state, s * 1e-5 * direction)) for s in (1, -1))
    np.testing.assert_allclose(slope, (plus - minus) / 2e-5, rtol=1e-5, atol=1e-9)
    assert (coefficient == 0.0) == (slope[0] == 0.0)


def test_the_mean_face_is_within(start: State):
    tone: Tone = tone_of(geometry())
    low, high = tone.limits
    assert low + 1.0 < skin(start) < high - 0.2


def test_a_person_s_skin_counts_once(start: State):
    term, state = ToneTerm(tone_of(geometry())), toned(start, -1.0)
    alone = term.at(state).weighed(state).energies["tone"]
    assert alone > 0.5
    for shared, energy in ((frozenset({"albedo"}), 0.0), (frozenset({"identity"}), alone)):
        beside = term.beside_another(shared).at(state).weighed(state)
        assert beside.energies["tone"] == energy == beside.robust["tone"]


def test_skin_of_one_color_is_as_it_is(start: State):
    tone = replace(tone_of(geometry()), by_albedo=np.zeros(len(start.albedo)))
    assert not tone.coefficients(-1.0).any()
