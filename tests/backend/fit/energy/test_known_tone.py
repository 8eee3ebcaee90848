"""The skin is as light as somebody says."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.skin_tone import typology_angle
from facestage.fit.energy.exposure_term import somebody_exposed
from facestage.fit.energy.known_tone import SIGMA, KnownTone
from facestage.fit.energy.tone_term import ToneTerm
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.given.problem import read_problem
from facestage.models.registry import load_model
from facestage.stress.scene import plain_scene, render, write_job


@cache
def geometry() -> FaceGeometry:
    return FaceGeometry(load_model("default"))


def color(state: State) -> np.ndarray:
    """Of the narrow face, the mean of its log albedo, by the model's own sum."""
    log_albedo = geometry().log_albedo + np.tensordot(state.albedo, geometry().albedo_basis, 1)
    return np.exp(log_albedo[geometry().model.regions["narrow_face"]].mean(axis=0))


@pytest.fixture
def state() -> State:
    state = plain_scene(geometry().model, seed=1, side_px=64).state
    return replace(state, albedo=np.random.default_rng(2).normal(0, 0.5, len(state.albedo)))


def test_it_costs_how_far_the_face_s_color_is_from_the_tone(state: State):
    (residual,) = KnownTone.of(geometry(), 20.0).residuals(state)
    assert residual == pytest.approx((typology_angle(color(state)) - 20.0) / SIGMA, abs=1e-3)
    assert abs(residual) > 1


def test_the_slope_is_that_of_the_residual(state: State):
    tone, layout = KnownTone.of(geometry(), -30.0), Layout(state)
    direction = np.random.default_rng(0).normal(size=layout.size)
    slope = tone.jacobian(state, layout) @ direction
    plus, minus = (tone.residuals(layout.apply(state, s * 1e-5 * direction)) for s in (1, -1))
    np.testing.assert_allclose(slope, (plus - minus) / 2e-5, rtol=1e-4)
    assert abs(slope[0]) > 1


@pytest.mark.parametrize("angle", [-75.0, -30.0, 15.0, 65.0])
def test_the_likeliest_skin_has_the_tone(state: State, angle: float):
    skin = replace(state, albedo=KnownTone.of(geometry(), angle).coefficients())
    assert typology_angle(color(skin)) == pytest.approx(angle, abs=1.0)
    # By the first three, which are of all of the skin.
    assert (skin.albedo[3:] ** 2).sum() < 0.01 * (skin.albedo[:3] ** 2).sum()


def test_vertices_that_are_not_rendered_change_nothing():
    """Lashes or clothes of a user's mesh may come before its face."""
    model, count = load_model("default"), 5000

    def after(values: np.ndarray) -> np.ndarray:
        return np.concatenate([np.zeros_like(values[..., :count, :]), values], axis=-2)

    polygons = model.polygons
    moved = replace(
        model,
        vertices=after(model.vertices),
        polygons=np.where(polygons < 0, polygons, polygons + count).astype(polygons.dtype),
        identity_basis=after(model.identity_basis),
        expression_basis=after(model.expression_basis),
        albedo_mean=np.concatenate([np.full((count, 3), 0.5, np.float32), model.albedo_mean]),
        albedo_basis=after(model.albedo_basis),
        regions={name: index + np.int32(count) for name, index in model.regions.items()},
        landmarks={},
    )
    tone, other = (KnownTone.of(FaceGeometry(each), 20.0) for each in (model, moved))
    np.testing.assert_allclose(other.mean, tone.mean)
    np.testing.assert_allclose(other.by_albedo, tone.by_albedo)


def test_a_model_of_one_skin_stays_as_it_is(state: State):
    tone = KnownTone.of(geometry(), -30.0)
    alike = replace(tone, by_albedo=0 * tone.by_albedo)
    np.testing.assert_array_equal(alike.coefficients(), 0 * state.albedo)
    assert np.isfinite(alike.residuals(state)).all()


def test_a_person_s_skin_counts_once(state: State):
    term = ToneTerm(KnownTone.of(geometry(), 60.0))
    alone = term.at(state).weighed(state).energies["known_tone"]
    assert alone > 1
    for shared, energy in ((frozenset({"albedo"}), 0.0), (frozenset({"identity"}), alone)):
        beside = term.beside_another(shared).at(state).weighed(state)
        assert beside.energies["known_tone"] == energy


def test_a_known_tone_takes_the_place_of_the_exposure(renderer: str, tmp_path: Path):
    scene = plain_scene(load_model("default"), seed=5, side_px=64)
    guessed = read_problem(write_job(tmp_path, scene, render(scene)))
    guessed = replace(guessed, photograph=replace(guessed.photograph, developed=True))
    told = replace(guessed, job=replace(guessed.job, skin_tone=20.0))
    assert somebody_exposed(guessed) and not somebody_exposed(told)
    assert guessed.fingerprint != told.fingerprint
    with pytest.raises(InputError, match="gives a skin tone, but holds the albedo"):
        read_problem(replace(told.job, freeze=("albedo",)))
