"""The obvious alternative: the fit's energy, by Mitsuba's gradients and Adam.

Photo, landmarks, outline and priors are the fit's own terms, robust and weighted alike. Fairly: it
starts where the fit's photo phases start (pose and shape from landmarks, lights by non-negative
least squares), its learning rates are per kind of parameter and decay, and the linear bases are
applied outside of automatic differentiation, which is faster.

What differs: lamps stay in their places, by which Mitsuba does not differentiate; the specular map
is interpolated between vertices rather than texels; a pixel is a few paths at random places in it
rather than its middle. A pixel's weight is estimated anew every WEIGHTS_EVERY iterations, and where
the face's outline lies every ANCHORS_EVERY, rather than at every step: an iteration moves the face
by much less.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from facestage.bench.settings import AdamSettings, Rates
from facestage.bench.solver import finished_track, landmark_start
from facestage.bench.trace import Snapshot, Track
from facestage.contract.errors import InputError
from facestage.fit.energy.energy import Energy
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import BELOW, BLOCKS
from facestage.fit.forward.reflectance import albedo_of, by_log
from facestage.fit.forward.shading import ForwardModel, bilinear_weights
from facestage.fit.given.problem import FINE_FACE_PX, Problem
from facestage.fit.given.truth import Truth
from facestage.fit.runs.driver import FitRun
from facestage.fit.stages.passage import Passage
from facestage.fit.stages.phases import Phase, Schedule
from facestage.render.gradient_scene import GradientScene, SceneValues, Target

WEIGHTS_EVERY = 25  # iterations between estimates of the photo's noise
ANCHORS_EVERY = 5  # iterations between looks for what the other terms compare with what
WEIGHT_SAMPLES = 2
BETA_1, BETA_2, EPSILON = 0.9, 0.999, 1e-12
LAST_RATE = 0.1  # share of the learning rate at the end
SNAPSHOT_STEP = 1.12  # a snapshot whenever this much more time has passed


class Adam:
    """Kingma & Ba 2015, algorithm 1, with a learning rate per parameter."""

    def __init__(self, rates: np.ndarray) -> None:
        self.rates = rates
        self.m, self.v, self.t = np.zeros_like(rates), np.zeros_like(rates), 0

    def step(self, gradient: np.ndarray, share: float = 1.0) -> np.ndarray:
        """The change of the parameters; ``share`` scales the learning rates."""
        self.t += 1
        self.m = BETA_1 * self.m + (1 - BETA_1) * gradient
        self.v = BETA_2 * self.v + (1 - BETA_2) * gradient**2
        m, v = self.m / (1 - BETA_1**self.t), self.v / (1 - BETA_2**self.t)
        return -share * self.rates * m / (np.sqrt(v) + EPSILON)


def learning_rates(layout: Layout, rates: Rates, light_scale: float) -> np.ndarray:
    """(size,) for every parameter; the focal length is held."""
    result = np.zeros(layout.size)
    for name in ("identity", "expression", "albedo", "roughness", "specular"):
        result[layout.slices[name]] = getattr(rates, name)
    result[layout.slices["lights"]] = rates.lights * light_scale
    result[layout.slices["pose"]] = [rates.turn] * 3 + [rates.shift] * 3
    return result


class SceneMap:
    """From a state to the scene's values, and from derivatives by those to derivatives by the
    parameters.
    """

    def __init__(self, forward: ForwardModel, layout: Layout, specular_size: int) -> None:
        self.forward, self.layout = forward, layout
        self.geometry: FaceGeometry = forward.geometry
        model, count = self.geometry.model, len(self.geometry.mean)
        uvs = np.zeros((count, 2))
        # A vertex on a seam takes the place of one of its corners.
        uvs[self.geometry.triangles.ravel()] = model.uvs[self.geometry.triangle_uvs.ravel()]
        texel, weight = bilinear_weights(uvs, specular_size)
        row = np.repeat(np.arange(count), texel.shape[1])
        self.texture = sp.csr_matrix(
            (weight.ravel(), (row, texel.ravel())), shape=(count, specular_size**2)
        )

    def values(self, state: State) -> SceneValues:
        """What the scene shows at ``state``."""
        albedo = albedo_of(self.forward.log_albedo(state))
        return SceneValues(
            self.forward.pose(state)[1],
            albedo,
            self.texture @ state.specular.ravel(),
            state.roughness,
            self.forward.lights.radiance(state.lights),
        )

    def gradient(self, state: State, values: SceneValues, derivative: SceneValues) -> np.ndarray:
        """(size,) by the chain rule; pose as :meth:`Layout.apply` moves it."""
        slices, geometry = self.layout.slices, self.geometry
        result = np.zeros(self.layout.size)
        by_vertex = derivative.vertices
        arm = values.vertices - state.translation
        result[slices["pose"]] = np.concatenate([np.cross(arm, by_vertex).sum(0), by_vertex.sum(0)])
        by_shape = geometry.basis.T @ (by_vertex @ state.rotation).ravel().astype(np.float32)
        where = self.layout.shape
        result[where] = by_shape[: where.stop - where.start]
        by_logs = by_log(derivative.albedo, values.albedo)
        result[slices["albedo"]] = (
            geometry.albedo_basis.reshape(len(geometry.albedo_basis), -1) @ by_logs.ravel()
        )
        result[slices["specular"]] = self.texture.T @ derivative.c_spec
        result[slices["roughness"]] = derivative.roughness
        lights = self.forward.lights
        jacobian = lights.jacobian(state.lights)
        result[slices["lights"]] = np.einsum(
            "nc,ncp->p", derivative.radiance[lights.fitted], jacobian
        )
        return result


class AdamRun:
    """The alternative's loss, its gradient, and its steps.

    ``energy`` is the fit's, at one resolution.
    """

    def __init__(self, energy: Energy, state: State, samples: int) -> None:
        """``state`` has the camera of the energy's resolution."""
        assert energy.photo is not None
        self.energy, self.photo, self.samples = energy, energy.photo, samples
        # Mitsuba differentiates the photo; the rest has closed forms.
        self.others = energy.without(PhotoTerm)
        forward = self.photo.forward
        self.map = SceneMap(forward, energy.layout, len(state.specular))
        self.scene = GradientScene(
            forward.geometry.triangles, state.camera, self.photo.stage, self.map.values(state)
        )
        self.target, self.anchors = self.weigh(state, 0), self.others.at(state)

    def weigh(self, state: State, seed: int) -> Target:
        """The photo with the weights that the fit's noise model gives at ``state``."""
        evaluation = self.photo.evaluate(state, seed)
        weights = self.photo.weights(evaluation, self.photo.noise(evaluation))
        return Target(self.photo.photo.color, self.photo.photo.clipped, weights)

    def loss(self, state: State, seed: int) -> tuple[float, np.ndarray]:
        """Energy and its gradient (size,) by the parameters."""
        values = self.map.values(state)
        photo, derivative = self.scene.gradient(values, self.target, self.samples, seed)
        others = self.anchors.system(state)
        gradient = self.map.gradient(state, values, derivative) + others.gradient
        return photo + sum(others.robust.values()), gradient


def run_adam(problem: Problem, truth: Truth, settings: AdamSettings, detail: bool = True) -> Track:
    """Minimise the energy of ``problem`` with Adam until the budget is spent."""
    if problem.fit_focal:
        raise InputError(
            "The alternative does not fit the focal length; give the case a camera.json."
        )
    forward = ForwardModel(problem.geometry, problem.lights)
    snapshots: list[Snapshot] = []
    with tempfile.TemporaryDirectory(prefix="facestage-bench-") as folder:
        run = FitRun(problem, forward, Path(folder), schedule=Schedule(Schedule().landmark_phases))
        start = landmark_start(run, snapshots)
        began = time.monotonic() - start.seconds
        blocks = tuple(name for name in BLOCKS if name not in BELOW)
        phase = Phase("adam", blocks, FINE_FACE_PX * settings.resolution, 0, WEIGHT_SAMPLES)
        # Mitsuba differentiates direct light.
        direct = replace(start.state, interreflection=0.0, translucency=0.0)
        passage = Passage.prepared(run.view, phase, direct)
        if passage is None:
            raise InputError("Everything is frozen; there is nothing to compare.")
        state, fit = passage.scaled, passage.descent
        layout = fit.energy.layout
        descent = Adam(learning_rates(layout, settings.rates, run.view.light_scale) * ~fit.freeze)
        # Making the scene and compiling its kernels is off the clock: nobody does it twice.
        setting_up = time.monotonic()
        adam = AdamRun(fit.energy, state, settings.samples)
        adam.loss(state, problem.job.seed)
        began += time.monotonic() - setting_up
        for number in range(settings.iterations):
            elapsed = time.monotonic() - began
            if elapsed > settings.budget:
                break
            if number % WEIGHTS_EVERY == 0 and number:
                adam.target = adam.weigh(state, number)
            if number % ANCHORS_EVERY == 0 and number:
                adam.anchors = adam.others.at(state)
            _, gradient = adam.loss(state, problem.job.seed + 2 * number)
            done = max(elapsed / settings.budget, number / settings.iterations)
            change = descent.step(gradient, LAST_RATE**done)
            values = layout.values(state)
            state = layout.apply(state, np.clip(values + change, fit.low, fit.high) - values)
            seconds = time.monotonic() - began
            if seconds > SNAPSHOT_STEP * snapshots[-1].seconds or number == settings.iterations - 1:
                snapshots.append(
                    Snapshot(seconds, f"Adam, {number + 1}", _full_size(state, direct), lit=True)
                )
        seconds = time.monotonic() - began
    state = _full_size(state, direct)
    if seconds > snapshots[-1].seconds:
        snapshots.append(Snapshot(seconds, "Adam, end", state, lit=True))
    lit = start.stage.with_radiance(problem.lights.radiance(state.lights))
    track = Track(snapshots, forward, lit)
    fitted = replace(start, state=state, stage=lit, seconds=seconds, trace=[])
    return finished_track(track, problem, truth, fitted) if detail else track


def _full_size(state: State, reference: State) -> State:
    return replace(state, camera=reference.camera)
