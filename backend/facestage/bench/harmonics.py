"""The fit with low-frequency light: nine spherical harmonics, Lambert, no shadows, no highlights.

The image formation of Garrido et al. 2016 and FML (Tewari et al. 2019), under the same solver,
priors and noise model as the ray-traced fit: what is left to compare is what shadows and highlights
do to geometry.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.bench.settings import SolverSettings
from facestage.bench.solver import landmark_start
from facestage.bench.trace import Snapshot, Track
from facestage.contract.light_stage import LightStage, fibonacci_stage
from facestage.fit.face.light_parameters import CHANNELS
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHAPE, SKIN
from facestage.fit.forward.shading import ForwardModel, Surface
from facestage.fit.given.problem import Problem
from facestage.fit.runs.driver import FitRun
from facestage.fit.solve.cholesky import with_ridge
from facestage.fit.stages.passage import Passage
from facestage.fit.stages.phases import Phase, PhaseName, Schedule
from facestage.render.light_terms import PLAIN, Asked, LightTerms

COEFFICIENTS = 9
RIDGE = 1e-3  # of the largest eigenvalue


def harmonic_basis(normals: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Nine spherical harmonics (P, 9) of unit ``normals`` (P, 3) and their gradients (P, 9, 3).

    Scaled by the cosine lobe's share of each band (Ramamoorthi & Hanrahan 2001, eq. 7 over pi), so
    that coefficients of one size weigh alike; the first is 1.
    """
    x, y, z = normals.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    first, second = 2.0 / 3.0 * np.sqrt(3.0), 0.25 * np.sqrt(15.0)
    polar = 0.125 * np.sqrt(5.0)
    values = [
        one,
        first * y,
        first * z,
        first * x,
        second * x * y,
        second * y * z,
        polar * (3 * z * z - 1),
        second * x * z,
        0.5 * second * (x * x - y * y),
    ]
    gradients = [
        (zero, zero, zero),
        (zero, first * one, zero),
        (zero, zero, first * one),
        (first * one, zero, zero),
        (second * y, second * x, zero),
        (zero, second * z, second * y),
        (zero, zero, 6 * polar * z),
        (second * z, zero, second * x),
        (second * x, -second * y, zero),
    ]
    return np.stack(values, axis=1), np.stack([np.stack(row, axis=1) for row in gradients], axis=1)


class HarmonicForward(ForwardModel):
    """Renders the face under nine "lights", one per harmonic; their radiance may be negative."""

    def light_terms(
        self,
        state: State,
        surface: Surface,
        stage: LightStage,
        samples: int,
        seed: int,
        asked: Asked = PLAIN,
        *,
        traced: np.ndarray | None = None,
        pairs: tuple[np.ndarray, np.ndarray] | None = None,
        roughness: np.ndarray | None = None,
        bounced: bool = True,
    ) -> LightTerms:
        """Irradiance by each harmonic; where the lights are and what they hit plays no part."""
        values, gradients = harmonic_basis(surface.normals)
        by_normal = np.pi * np.einsum("pjx,jc->pcx", gradients, self.lights.radiance(state.lights))
        channels = np.zeros((len(values), CHANNELS))
        return LightTerms(
            np.pi * values,
            np.zeros_like(values),
            by_normal,
            np.zeros_like(by_normal),
            channels,
            channels,
            channels,
        )


def run_harmonics(problem: Problem, settings: SolverSettings) -> Track:
    """The default schedule, without its specular phase and parameters, over the harmonic image."""
    problem = harmonic_problem(problem)
    forward = HarmonicForward(problem.geometry, problem.lights)
    schedule = (
        Schedule().scaled(settings.resolution, settings.samples).limited(problem.fineness.steps_max)
    )
    snapshots: list[Snapshot] = []
    with tempfile.TemporaryDirectory(prefix="facestage-bench-") as folder:
        run = FitRun(problem, forward, Path(folder), schedule=Schedule(schedule.landmark_phases))
        start = landmark_start(run, snapshots)
        began = time.monotonic() - start.seconds
        deadline = began + (float("inf") if settings.budget is None else settings.budget)
        state = replace(start.state, translucency=0.0)  # Lambert's skin sends as much everywhere
        for whole in schedule.photo_phases:
            if whole.name == PhaseName.SPECULAR:
                continue
            # Harmonics throw no shadows.
            phase = replace(
                whole.varied("", set(whole.blocks) - {*SHAPE, *SKIN}), shadow_edges=False
            )
            if not state.lights.any():
                state = _initial_harmonics(run, phase, state)
            passage = Passage.prepared(run.view, phase, state, keep_light=True)
            if passage is None:
                continue
            descent = passage.descent
            descent.low[descent.energy.layout.slices["lights"]] = -np.inf
            for _ in passage.steps(deadline):
                state, seconds = passage.state, time.monotonic() - began
                snapshots.append(Snapshot(seconds, phase.name, state, lit=True))
    return Track(snapshots, forward, problem.lit_stage)


def harmonic_problem(problem: Problem) -> Problem:
    """The problem with nine lights that stand for the harmonics; their places mean nothing."""
    freeze = tuple(name for name in problem.job.freeze if name != "lights")
    stage = fibonacci_stage(COEFFICIENTS)
    return replace(
        problem,
        job=replace(problem.job, stage=stage, light_color="multi", freeze=freeze),
        stage=stage,
    )


def _initial_harmonics(run: FitRun, phase: Phase, state: State) -> State:
    """Coefficients by linear least squares on the current geometry and albedo; sets the scale of
    E_light.
    """
    descent = run.view.descent(phase, state)
    assert descent is not None and descent.energy.photo is not None
    photo = descent.energy.photo
    evaluation = photo.evaluate(run.view.scaled(phase, state), run.problem.job.seed)
    image = evaluation.image
    y, x = photo.index(image.surface)
    coefficients = np.zeros((COEFFICIENTS, CHANNELS))
    shown = image.skin.by_light(image.terms.diffuse, image.terms.specular)
    for channel, columns in enumerate(shown):
        usable = evaluation.base_weight[y, x] * ~photo.photo.clipped[y, x, channel]
        weighted = columns * usable[:, None]
        normal = weighted.T @ columns
        target = weighted.T @ photo.photo.color[y, x, channel]
        coefficients[:, channel] = np.linalg.solve(with_ridge(normal, RIDGE), target)
    run.view.light_scale = max(float(np.abs(coefficients[0]).mean()), 1e-9)
    return replace(state, lights=coefficients.ravel())
