"""The guards at their limits, and what they are computed from."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from facestage.contract.job import Weights
from facestage.fit.energy.landmark_term import LandmarkTerm
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.stages.phases import Phase
from facestage.fit.stages.photo_descent import PhotoDescent
from facestage.fit.trust.checks import _names, _settled
from facestage.fit.trust.guard import (
    doubt,
    informative_share,
    landmark_energy,
    landmark_statistic,
    statistic_limit,
)
from reference.synthetic_scene import Scene, moved, plain_photo


@pytest.mark.parametrize(
    ("statistic", "psnr", "share", "word"),
    [
        (10.0, 15.0, 0.2, ""),
        (10.001, 15.0, 0.2, "squared distance"),
        (10.0, 14.99, 0.2, "PSNR"),
        (10.0, 15.0, 0.199, "black"),
        (10.0, float("inf"), 1.0, ""),
        (10.0, float("nan"), 1.0, ""),
    ],
)
def test_at_its_limit_a_photo_is_believed(statistic: float, psnr: float, share: float, word: str):
    found = doubt(statistic, 10.0, psnr, share)
    assert (word in found) if word else found == ""


def test_without_a_free_parameter_the_limit_is_that_of_one():
    assert (
        statistic_limit(0)
        == statistic_limit(1)
        < statistic_limit(2)
        == pytest.approx(13.816, abs=1e-3)
    )


def stage_of(scene: Scene, weights: Weights) -> PhotoDescent:
    return scene.solver(np.zeros((96, 96, 3)), ("pose",), 1, weights)


def test_the_statistic_counts_landmarks_shape_and_lens_and_no_more(scene: Scene):
    energy = stage_of(scene, Weights(landmarks=0.5)).energy
    # Skin, pose and light cost the statistic nothing but what they cost the landmarks.
    start = replace(scene.state, expression=np.zeros(3))
    longer = moved(start, focal=0.5)
    landmarks = energy.term(LandmarkTerm)
    unseen = replace(landmarks, weight=0.0)
    blind = replace(energy, terms=(*energy.without(LandmarkTerm).terms, unseen))
    # A lens longer by two of its deviations of a quarter: 2^2.
    assert landmark_statistic(blind, start, longer) == pytest.approx(4.0)
    assert landmark_statistic(blind, longer, start) == pytest.approx(-4.0)
    assert (
        landmark_statistic(blind, start, replace(start, roughness=0.9, albedo=np.full(5, 3.0))) == 0
    )
    smiling = replace(start, expression=np.array([0.35, 0, 0]))
    assert landmark_energy(blind, smiling) - landmark_energy(blind, start) == pytest.approx(0.5)
    placed = landmarks.at(start)
    residuals = placed.residuals(start)
    wanted = 0.5 * placed.robust_energy(residuals) + 0.5 * (start.identity**2).sum()
    assert landmark_energy(energy, start) == pytest.approx(wanted)


def test_black_and_saturated_pixels_say_nothing(scene: Scene):
    photo = scene.render(samples=4)[0] + 0.1
    term = scene.photo_term(photo, 2)
    evaluation = term.evaluate(scene.state, 1)
    count = len(evaluation.image.color)
    assert informative_share(term.photo, evaluation) == 1.0
    column, row = evaluation.image.surface.pixels.astype(int).T
    dark, clipped = photo.copy(), np.zeros(photo.shape, bool)
    dark[row[:30], column[:30]] = 0.0
    dark[row[30:50], column[30:50], :2] = 0.0  # still blue
    clipped[row[50:90], column[50:90]] = True
    clipped[row[90:120], column[90:120], 1:] = True  # red is still known
    found = informative_share(plain_photo(dark, clipped), evaluation)
    assert found == pytest.approx(1 - (30 + 40) / count)
    nothing = replace(
        evaluation,
        image=replace(evaluation.image, surface=evaluation.image.surface.part(slice(0, 0))),
    )
    assert informative_share(term.photo, nothing) == 0.0


def view_of(scene: Scene, frozen: set[str], share: float = 0.05) -> Any:
    """What a check of the trace asks of a view."""
    fineness = SimpleNamespace(settled_share=share)
    return SimpleNamespace(
        problem=SimpleNamespace(fineness=fineness),
        start_state=lambda: scene.state,
        frozen=lambda: frozen,
    )


@pytest.mark.parametrize(
    ("errors", "settled"),
    [
        ([], False),
        ([1.0], True),
        ([1.0, 0.5], True),
        ([1.0, 0.9, 0.86], True),
        ([1.0, 0.9, 0.85], False),
        ([1.0, None, 0.5], True),
        ([None, 1.0, 0.5], False),
        ([1.0, 0.9, None], True),
    ],
)
def test_a_phase_has_settled_when_it_ended_by_itself_or_its_last_step_was_small(
    scene: Scene, errors: list[float | None], settled: bool
):
    phase = Phase("joint", ("pose", "lights"), 160.0, 3)
    trace = [{"stage": "geometry", "photo_rms": 9.0}] + [
        {"stage": "joint", "photo_rms": error} for error in errors
    ]
    assert _settled(view_of(scene, set()), phase, trace) is settled
    assert _settled(view_of(scene, {"pose"}), phase, trace) is settled
    longer = replace(phase, steps=1, further=2)
    assert _settled(view_of(scene, set()), longer, trace) is settled, "it might have gone on as far"
    assert _settled(view_of(scene, {"pose", "lights"}), phase, trace) is True, "nothing was free"
    assert _settled(view_of(scene, set()), replace(phase, face_px=None), trace) is True, "no photo"


def test_light_parameters_are_named_by_the_lights_of_the_stage(scene: Scene):
    lit = np.array([True, False, True, True])
    fitted = np.array([True, False, True])
    for uniform, wanted in (
        (
            False,
            [
                f"light {number} {channel}"
                for number in (0, 3)
                for channel in ("red", "green", "blue")
            ],
        ),
        (True, ["light 0", "light 3", "color red", "color green", "color blue"]),
    ):
        lights = LightParameters(fitted, np.zeros((3, 3)), uniform)
        problem: Any = SimpleNamespace(lights=lights, lit=lit, geometry=scene.geometry)
        names = _names(problem)
        assert names["lights"] == wanted and len(wanted) == lights.size
        assert names["identity"] == list(scene.model.identity_names)
