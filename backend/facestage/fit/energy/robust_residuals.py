"""Residuals in standard deviations, weighed robustly: what a term of measured points is made of."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.term import Placed, Quadratic, Weighed
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State

# Beyond three standard deviations an observation is more likely wrong than unlucky.
CAUCHY_SCALE = 3.0


class RobustResiduals(Placed):
    """m observations of ``components`` residuals each, with a Cauchy loss on each observation.

    A subclass says what they are and how they move; it is a frozen dataclass with the fields
    ``weight``, a factor on the whole energy, and ``share`` or one for all, of an independent
    observation that each one stands for.
    """

    name: ClassVar[str]  # of its energy
    components: ClassVar[int] = 1
    cauchy_scale: ClassVar[float] = CAUCHY_SCALE
    weight: float
    share: np.ndarray | float

    @abstractmethod
    def residuals(self, state: State) -> Float[np.ndarray, " residuals"]:
        """The residuals in standard deviations, observation by observation."""

    @abstractmethod
    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "residuals unknowns"]:
        """The derivative of :meth:`residuals`."""

    def scales(
        self, residuals: Float[np.ndarray, " residuals"]
    ) -> Float[np.ndarray, " observations"] | float:
        """Of the Cauchy loss, for each observation or for all; alike within an observation."""
        return self.cauchy_scale

    def robust_weights(
        self, residuals: Float[np.ndarray, " residuals"]
    ) -> Float[np.ndarray, " residuals"]:
        """The weights without ``weight``, equal within an observation."""
        weights = self.share / (1.0 + self._squared(residuals) / self.scales(residuals) ** 2)
        return np.repeat(weights, self.components)

    def robust_energy(self, residuals: Float[np.ndarray, " residuals"]) -> float:
        """The Cauchy energy that :meth:`robust_weights` belong to, without ``weight``."""
        squares = np.square(self.scales(residuals))
        losses = self.share * squares * np.log1p(self._squared(residuals) / squares)
        return 0.5 * float(losses.sum())

    def _squared(
        self, residuals: Float[np.ndarray, " residuals"]
    ) -> Float[np.ndarray, " observations"]:
        return np.asarray((residuals.reshape(-1, self.components) ** 2).sum(axis=1))

    def weighed(self, state: State) -> WeighedResiduals:
        """With the weights of ``state``."""
        residuals = self.residuals(state)
        return WeighedResiduals(
            self, state, residuals, self.weight * self.robust_weights(residuals)
        )


class QuadraticResiduals(RobustResiduals):
    """Observations that are believed however far the face still is; the points that they hold are
    the same everywhere.
    """

    def at(self, state: State, evaluation: Evaluation | None = None) -> Self:
        """The term is placed as it is."""
        return self

    def robust_weights(
        self, residuals: Float[np.ndarray, " residuals"]
    ) -> Float[np.ndarray, " residuals"]:
        """All alike."""
        return np.full(len(residuals), self.share)

    def robust_energy(self, residuals: Float[np.ndarray, " residuals"]) -> float:
        """Half the sum of squares."""
        return 0.5 * float(np.sum(self.share * residuals**2))


@dataclass(frozen=True, eq=False)
class WeighedResiduals(Weighed):
    """The residuals (r,) at one state and their frozen weights (r,)."""

    placed: RobustResiduals
    state: State
    residuals: Float[np.ndarray, " residuals"]
    weights: Float[np.ndarray, " residuals"]

    @property
    def energies(self) -> dict[str, float]:
        """Half the weighted sum of squares."""
        return {self.placed.name: 0.5 * float(self.weights @ self.residuals**2)}

    @property
    def robust(self) -> dict[str, float]:
        """The Cauchy energy."""
        return {self.placed.name: self.placed.weight * self.placed.robust_energy(self.residuals)}

    def add_to(self, total: Quadratic) -> None:
        """By the exact Jacobian."""
        jacobian = self.placed.jacobian(self.state, total.layout)
        total.add_residuals(jacobian, self.weights, self.residuals)

    def decrease(self, state: State, evaluation: Evaluation | None) -> float:
        """A face behind the camera has no residuals."""
        residuals = self.placed.residuals(state)
        if not np.isfinite(residuals).all():
            return -np.inf
        before = 0.5 * float(self.weights @ self.residuals**2)
        return before - 0.5 * float(self.weights @ residuals**2)
