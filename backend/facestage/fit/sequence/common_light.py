"""One light for all frames, from the keyframes: each of them had found its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from facestage.contract.job import WITHOUT, Job
from facestage.contract.landmarks import Landmarks
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import UNKNOWNS
from facestage.fit.given.black_and_white import as_seen_in_color
from facestage.fit.given.problem import Problem
from facestage.fit.given.window import Window
from facestage.fit.sequence.actor import Actor
from facestage.fit.solve.bounded_step import bounded_step
from facestage.fit.stages.phases import Phase
from facestage.fit.stages.view import View
from facestage.images.image_io import Photograph

PHASE = Phase("light", ("lights",), 64.0, 1, 2)
STEPS = 4
DAMPING = 1e-3


def with_common_light(
    actor: Actor,
    photographs: Sequence[Photograph],
    landmarks: Sequence[Landmarks],
    states: Sequence[State],
) -> Actor:
    """The actor under the lights that explain all keyframes best, whose faces are at ``states``."""
    (prior,) = (unknown.priors["light"] for unknown in UNKNOWNS if unknown.name == "lights")
    views = [_view(actor, *one) for one in zip(photographs, landmarks, strict=True)]
    for _ in range(STEPS):
        lights = actor.state.lights
        hessian, gradient = np.zeros((len(lights), len(lights))), np.zeros(len(lights))
        for view, state in zip(views, states, strict=True):
            view.light_scale = max(float(actor.forward.lights.radiance(lights).mean()), 1e-9)
            at = actor.at(state.rotation, state.translation, state.expression)
            term, scaled = view.photo_term(PHASE, at), view.scaled(PHASE, at)
            assert term is not None
            evaluation = term.evaluate(scaled, PHASE.seed)
            layout = Layout(scaled)
            weights = term.weights(evaluation, term.noise(evaluation))
            more, slope = term.normal_equations(
                evaluation, weights, layout, layout.mask(PHASE.blocks)
            )
            where = layout.slices["lights"]
            hessian += more[where, where]
            gradient += slope[where]
        prior(view.known(PHASE, at), len(lights)).add_to(hessian, gradient, lights)
        low, high = np.zeros(len(lights)), np.full(len(lights), np.inf)
        every = np.ones(len(lights), bool)
        step = bounded_step(hessian, gradient, DAMPING, lights, low, high, every)
        actor = actor.lit(lights + step.step)
    return actor


def _view(actor: Actor, photograph: Photograph, landmarks: Landmarks) -> View:
    """A keyframe as a photo of the fit, its person and light those of the ``actor``."""
    job = Job(
        image=Path("frame"),
        landmarks=landmarks,
        camera=actor.camera,
        stage=actor.stage,
        camera_to_stage=actor.camera_to_stage,
        surround=WITHOUT,
    )
    window = Window.of(*photograph.size, landmarks)
    problem = Problem(
        job,
        as_seen_in_color(window.photograph(photograph), window.landmarks(landmarks)),
        window.camera(actor.camera),
        window.landmarks(landmarks),
        actor.geometry,
        actor.stage,
        fit_focal=False,
        focal_sigma=1.0,
        window=window,
    )
    return View(problem, actor.forward)
