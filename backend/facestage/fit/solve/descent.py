"""The step loop: damped Gauss-Newton steps until nothing is gained, whatever they are over."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np

from facestage.fit.solve.bounded_step import Damping, bounded_step

# A run ends when the energy falls by less than this share in a step.
CONVERGED_SHARE = 1e-3
# An energy that jumps between steps, as what is seen does, hides small gains: what four dampings,
# from nearly none to several times the curvature, cannot lower is as low as it gets.
MAX_REJECTIONS = 4
HOPELESS_SHARE = 5e-3
# Steps after which parameters that rest are asked whether they want to move again.
WOKEN_EVERY = 4

S = TypeVar("S")  # what is fitted
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


class _Accepted(NamedTuple, Generic[S, E]):
    """A step that lowered the energy: where it leads, by how much, and of which system."""

    state: S
    evaluation: E
    decrease: float
    condition: float


@dataclass
class Descent(ABC, Generic[S, E, Q, T]):
    """A run of the damped Gauss-Newton solver, whatever it is over."""

    steps: int
    low: np.ndarray
    high: np.ndarray
    tolerance: float
    damping: Damping
    further: int = 0  # steps after these, as long as it has not settled

    def run(self, state: S, seed: int, deadline: float, first: int = 1) -> Iterator[T]:
        """Accepted steps, numbered from ``first``, until converged, out of steps, or past the
        ``deadline`` (time.monotonic).
        """
        evaluation = self.evaluate(state, seed, everything=wakes(first))
        most = self.steps + self.further
        for number in range(first, most + 1):
            system = self.system(state, evaluation)
            if wakes(number):
                self.rest(state, system.gradient)
            step = self._step(state, system, number, seed, deadline)
            if step is None:
                return
            before, state, evaluation = evaluation, step.state, step.evaluation
            converged = step.decrease < self.tolerance * max(system.total, 1e-12)
            enough = number == most or (number >= self.steps and self.settled(before, evaluation))
            finished = enough or converged
            yield self.accepted(number, state, evaluation, system, step.condition, finished)
            if finished or time.monotonic() > deadline:
                return

    def last(self, state: S, seed: int, deadline: float = float("inf")) -> T | None:
        """The last step of a run that nobody listens to; None where none is accepted."""
        return next(iter(deque(self.run(state, seed, deadline), maxlen=1)), None)

    def _step(
        self, state: S, system: Q, number: int, seed: int, deadline: float
    ) -> _Accepted[S, E] | None:
        """The first of a few proposals, each damped more, that lowers the energy; None: none."""
        free = self.free()
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
            trial = self.evaluate(candidate, seed, everything=wakes(number + 1))
            decrease = system.decrease(candidate, trial)
            if decrease > 0 and proposal.predicted > 0:
                self.damping.accept(decrease / proposal.predicted)
                return _Accepted(candidate, trial, decrease, proposal.condition)
            self.damping.reject()
            # What is left to gain is less than what visibility jumps by from step to step.
            hopeless = proposal.predicted < HOPELESS_SHARE * system.total
            if hopeless or time.monotonic() > deadline:
                return None
        return None

    @abstractmethod
    def evaluate(self, state: S, seed: int, everything: bool) -> E:
        """The model's answer at ``state``; ``everything``: what rests is looked at too."""

    @abstractmethod
    def system(self, state: S, evaluation: E) -> Q:
        """The quadratic model around ``state``, its weights frozen."""

    @abstractmethod
    def rest(self, state: S, gradient: np.ndarray) -> None:
        """Decide anew which parameters rest until they are asked again: those at a bound that the
        energy would push them through.
        """

    def settled(self, before: E, after: E) -> bool:
        """Whether a step between these answers, the last that is due, is a reason to stop."""
        return True

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


def wakes(number: int) -> bool:
    """Whether before step ``number`` all that rests is asked anew if it wants to move."""
    return number % WOKEN_EVERY == 1
