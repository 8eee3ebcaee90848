"""Damped Gauss-Newton steps until nothing is gained, whatever they are over: one photo, or several
of one person.
"""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

import numpy as np

from facestage.fit.solve.bounded_step import Damping, bounded_step

# A run ends when the energy falls by less than this share in a step.
CONVERGED_SHARE = 1e-3
# Shadows and silhouettes jump between steps; what three dampings cannot lower is as low as it gets.
MAX_REJECTIONS = 3
HOPELESS_SHARE = 5e-3
# Steps after which lights that were fitted to zero are asked whether they want to come back.
LIGHTS_ASKED_EVERY = 4

S = TypeVar("S")  # what is fitted: one photo's state, or those of several
E = TypeVar("E")  # the model's answer there
Q = TypeVar("Q", bound="QuadraticModel")
T = TypeVar("T")  # what is told of an accepted step


class QuadraticModel(Protocol):
    """The energy around one state."""

    hessian: np.ndarray
    gradient: np.ndarray
    total: float

    def decrease(self, state: Any, evaluation: Any) -> float:
        """How much lower the energy is at ``state``, the weights unchanged."""


@dataclass
class Descent(ABC, Generic[S, E, Q, T]):
    """A run of the damped Gauss-Newton solver, whatever it is over."""

    steps: int
    low: np.ndarray
    high: np.ndarray
    tolerance: float
    damping: Damping

    def run(self, state: S, seed: int, deadline: float, first: int = 1) -> Iterator[T]:
        """Accepted steps, numbered from ``first``, until converged, out of steps, or past the
        ``deadline``.
        """
        evaluation = self.evaluate(state, seed, everything=asks_lights(first))
        for number in range(first, self.steps + 1):
            system = self.system(state, evaluation)
            if asks_lights(number):
                self.rest_lights(state, system.gradient)
            free = self.free()
            accepted = False
            for _ in range(MAX_REJECTIONS):
                proposal = bounded_step(
                    system.hessian,
                    system.gradient,
                    self.damping.value,
                    self.values(state),
                    self.low,
                    self.high,
                    free,
                )
                candidate = self.moved(state, proposal.step)
                # The same random numbers on both sides of a comparison.
                trial = self.evaluate(candidate, seed, everything=asks_lights(number + 1))
                decrease = system.decrease(candidate, trial)
                if decrease > 0 and proposal.predicted > 0:
                    self.damping.accept(decrease / proposal.predicted)
                    accepted = True
                    break
                self.damping.reject()
                # What is left to gain is less than what visibility jumps by from step to step.
                if (
                    time.monotonic() > deadline
                    or proposal.predicted < HOPELESS_SHARE * system.total
                ):
                    return
            if not accepted:
                return
            state, evaluation = candidate, trial
            finished = number == self.steps or decrease < self.tolerance * max(system.total, 1e-12)
            yield self.accepted(number, state, evaluation, system, proposal.condition, finished)
            if finished or time.monotonic() > deadline:
                return

    @abstractmethod
    def evaluate(self, state: S, seed: int, everything: bool) -> E:
        """The model's answer at ``state``; ``everything``: lights that rest are traced too."""

    @abstractmethod
    def system(self, state: S, evaluation: E) -> Q:
        """The quadratic model around ``state``, its weights frozen."""

    @abstractmethod
    def rest_lights(self, state: S, gradient: np.ndarray) -> None:
        """Lights at radiance 0 that the energy would only lower further rest until they are asked
        again.
        """

    @abstractmethod
    def free(self) -> np.ndarray:
        """(size,) bool, the parameters that the next step may move."""

    @abstractmethod
    def values(self, state: S) -> np.ndarray:
        """(size,) the values that ``low`` and ``high`` bound."""

    @abstractmethod
    def moved(self, state: S, step: np.ndarray) -> S:
        """The state after ``step`` (size,)."""

    @abstractmethod
    def accepted(
        self, number: int, state: S, evaluation: E, system: Q, condition: float, finished: bool
    ) -> T:
        """What is told of a step to ``state`` that ``system`` proposed."""


def asks_lights(number: int) -> bool:
    """Whether step ``number`` asks every dark light anew if it wants to come back."""
    return number % LIGHTS_ASKED_EVERY == 1
