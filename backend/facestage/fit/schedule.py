"""The multi-step schedule (Garrido et al. 2016, Algorithm 1) over the damped Gauss-Newton solver."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from facestage.fit.energy import Energy, Evaluation, common_energy
from facestage.fit.parameters import State
from facestage.fit.solver import Damping, bounded_step

# A stage ends when the energy falls by less than this share in a step.
CONVERGED_SHARE = 1e-3
# Shadows and silhouettes jump between steps; what three dampings cannot lower is as low as it gets.
MAX_REJECTIONS = 3
HOPELESS_SHARE = 5e-3
# Steps after which lights that were fitted to zero are asked whether they want to come back.
LIGHTS_ASKED_EVERY = 4


@dataclass(frozen=True)
class Iteration:
    """One accepted step: what the trace and the progress events are made of."""

    stage: str
    number: int
    state: State
    evaluation: Evaluation | None
    energy: dict[str, float]
    condition: float
    damping: Damping
    finished: bool
    hessian: np.ndarray  # (size, size) of the undamped system that the step was taken from
    prior_hessian: np.ndarray  # (size, size) the priors' part of it


@dataclass
class Stage:
    """A run of the solver over some blocks of parameters."""

    name: str
    blocks: tuple[str, ...]
    energy: Energy
    steps: int
    freeze: np.ndarray  # (size,) bool, true where the user, or the plan, holds a parameter
    low: np.ndarray
    high: np.ndarray
    tolerance: float = CONVERGED_SHARE
    damping: Damping = field(default_factory=Damping)

    def run(
        self, state: State, seed: int, deadline: float, first: int = 1, clock: Callable[[], float] = time.monotonic
    ) -> Iterator[Iteration]:
        """Accepted steps, numbered from ``first``, until converged, out of steps, or past the ``deadline``."""
        active = self.energy.layout.mask(self.blocks) & ~self.freeze
        evaluation = self._evaluate(state, seed, everything=self._asks_lights(first))
        for number in range(first, self.steps + 1):
            system = _System(self.energy, state, evaluation, active)
            if self._asks_lights(number):
                self._rest_lights(state, system.gradient, active)
            # The photo does not see a light that rests; the priors alone must not wake it.
            free = active & ~self._parameters_at_rest()
            accepted = False
            for _ in range(MAX_REJECTIONS):
                values = self.energy.layout.values(state)
                proposal = bounded_step(
                    system.hessian, system.gradient, self.damping.value, values, self.low, self.high, free
                )
                candidate = self.energy.layout.apply(state, proposal.step)
                # The same random numbers on both sides of a comparison.
                trial = self._evaluate(candidate, seed, everything=self._asks_lights(number + 1))
                decrease = system.decrease(candidate, trial)
                if decrease > 0 and proposal.predicted > 0:
                    self.damping.accept(decrease / proposal.predicted)
                    accepted = True
                    break
                self.damping.reject()
                # What is left to gain is less than what visibility jumps by from step to step.
                if clock() > deadline or proposal.predicted < HOPELESS_SHARE * system.total:
                    return
            if not accepted:
                return
            state, evaluation = candidate, trial
            finished = number == self.steps or decrease < self.tolerance * max(system.total, 1e-12)
            yield Iteration(
                self.name, number, state, evaluation, system.terms, proposal.condition, self.damping, finished,
                system.hessian, system.prior_hessian,
            )  # fmt: skip
            if finished or clock() > deadline:
                return

    def _evaluate(self, state: State, seed: int, everything: bool = False) -> Evaluation | None:
        if self.energy.photo is None or self.energy.stage is None:
            return None
        return self.energy.photo.evaluate(state, self.energy.stage, seed, everything)

    @property
    def resting(self) -> np.ndarray:
        """(N,) bool, the lights that rest; empty when none was asked yet."""
        photo = self.energy.photo
        return np.zeros(0, bool) if photo is None or photo.resting is None else photo.resting

    def _parameters_at_rest(self) -> np.ndarray:
        """(size,) bool, the parameters of the lights that rest, color of all lights left out."""
        result = np.zeros(self.energy.layout.size, bool)
        if self.resting.any():
            where = self.energy.layout.slices["lights"]
            result[where] = self.energy.light_parameters.of_lights(self.resting)
        return result

    def _asks_lights(self, number: int) -> bool:
        """Whether step ``number`` asks every dark light anew if it wants to come back."""
        return number % LIGHTS_ASKED_EVERY == 1

    def _rest_lights(self, state: State, gradient: np.ndarray, active: np.ndarray) -> None:
        """Lights at radiance 0 that the energy would only lower further rest until they are asked again."""
        photo = self.energy.photo
        if photo is None:
            return
        where = self.energy.layout.slices["lights"]
        settled = (state.lights <= self.low[where]) & (gradient[where] > 0) | ~active[where]
        photo.resting = self.energy.light_parameters.dark(state.lights, settled)


class _System:
    """The quadratic model around one state, with its weights frozen."""

    def __init__(self, energy: Energy, state: State, evaluation: Evaluation | None, active: np.ndarray) -> None:
        self.energy, self.state, self.evaluation = energy, state, evaluation
        lights = energy.light_parameters
        prior = energy.priors.quadratic(state, lights)
        self.prior_hessian = prior.hessian
        self.hessian, self.gradient = prior.hessian.copy(), prior.gradient
        self.terms = dict(prior.energy)
        self._prior_total = sum(prior.energy.values())
        self._landmarks = energy.landmarks.at(state)
        residual = self._landmarks.residuals(state)
        self._landmark_weights = energy.weights.landmarks * self._landmarks.robust_weights(residual)
        jacobian = self._landmarks.jacobian(state, energy.layout)
        # Most columns are those of light and skin, which move no landmark.
        moving = np.flatnonzero(jacobian.any(axis=0))
        jacobian = jacobian[:, moving]
        self.hessian[np.ix_(moving, moving)] += jacobian.T @ (jacobian * self._landmark_weights[:, None])
        self.gradient[moving] += jacobian.T @ (self._landmark_weights * residual)
        self._landmark_energy = 0.5 * float(self._landmark_weights @ residual**2)
        self.terms["landmarks"] = self._landmark_energy
        self._silhouette = energy.silhouette.find(state) if energy.silhouette is not None else None
        if self._silhouette is not None:
            residual = self._silhouette.residuals(state)
            self._silhouette_weights = energy.weights.photo * self._silhouette.weights(residual)
            jacobian = self._silhouette.jacobian(state, energy.layout)
            self.hessian += jacobian.T @ (jacobian * self._silhouette_weights[:, None])
            self.gradient += jacobian.T @ (self._silhouette_weights * residual)
            self.terms["silhouette"] = 0.5 * float(self._silhouette_weights @ residual**2)
        if evaluation is not None:
            assert energy.photo is not None
            self.noise = energy.photo.noise(evaluation)
            self._weights = energy.photo.weights(evaluation, self.noise, energy.weights.photo)
            hessian, gradient = energy.photo.normal_equations(evaluation, self._weights, energy.layout, active)
            self.hessian += hessian
            self.gradient += gradient
            self.terms["photo"] = common_energy(evaluation, evaluation, self._weights)[0]
        self.total = sum(self.terms.values())

    def decrease(self, state: State, evaluation: Evaluation | None) -> float:
        """How much lower the energy is at ``state``, the weights unchanged."""
        prior = sum(self.energy.priors.energies(state, self.energy.light_parameters).values())
        residual = self._landmarks.residuals(state)
        if not np.isfinite(residual).all():
            return -np.inf
        result = self._prior_total - prior
        result += self._landmark_energy - 0.5 * float(self._landmark_weights @ residual**2)
        if self._silhouette is not None:
            result += self.terms["silhouette"]
            result -= 0.5 * float(self._silhouette_weights @ self._silhouette.residuals(state) ** 2)
        if evaluation is not None and self.evaluation is not None:
            old, new = common_energy(self.evaluation, evaluation, self._weights)
            result += old - new
        return float(result) if np.isfinite(result) else -np.inf
