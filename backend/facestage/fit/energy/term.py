"""What a term of the energy is, and what the terms of a phase are made from.

A term lives in three steps, each shorter than the one before. It is *made* once for a phase, if it
has a say there. *Placed* at a state, it knows what it compares with what: which point of the cheek
is the outline, what the face looks like. *Weighed* at a state, its weights are frozen too: it is a
quadratic model, which the solver steps with and which says by how much a step lowered the energy.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.contract.light_stage import LightStage
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.plan import Plan
from facestage.fit.energy.white_skin import white_skin_of
from facestage.fit.face.lamps import turned
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import Known
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.photo import Photo
from facestage.fit.given.problem import Problem


@dataclass(frozen=True, eq=False, kw_only=True)
class Setup:
    """What the terms of a phase are made from, at the size that it sees the photo at."""

    problem: Problem
    forward: ForwardModel
    layout: Layout
    start: State  # where the phase begins
    factor: float  # what the job's photo is scaled by
    blocks: tuple[str, ...]  # of parameters that the phase is about
    freeze: Bool[np.ndarray, " unknowns"]  # parameters that are held all the same
    known: Known  # what the priors depend on
    photo: Photo | None = None  # without what hides the face; None: a phase of landmarks alone
    stage: LightStage | None = None  # camera frame, its lights not yet turned; None without photo
    pivot: Float[np.ndarray, " 3"] = field(default_factory=lambda: np.zeros(3))  # its centre
    samples: int = 1  # per light and pixel
    casting: Bool[np.ndarray, " lights"] | None = (
        None  # lights whose shadows move; None: nobody's do
    )
    plan: Plan = field(default_factory=Plan)

    @cached_property
    def white_skin(self) -> Float[np.ndarray, " lights"] | None:
        """The radiance of white skin where the face is lit well as the phase begins, under each
        light of radiance 1; None where too little of it shows, and without photo or light.
        """
        if self.photo is None or self.stage is None:
            return None
        stage = turned(self.stage, self.start.light_position, self.pivot)
        return white_skin_of(self.forward, self.start, self.photo, stage, self.problem.job.seed)

    @property
    def moves_light(self) -> bool:
        """Whether the phase moves any light in sight of the photo."""
        return self.photo is not None and self.stage is not None and self.moves(("lights",))

    def moves(self, blocks: Collection[str]) -> bool:
        """Whether any parameter of ``blocks`` is free in the phase."""
        wanted = self.layout.mask(set(self.blocks) & set(blocks))
        return bool((wanted & ~self.freeze).any())


@dataclass(frozen=True, eq=False)
class Quadratic:
    """0.5 x^T H x + g^T x by all parameters, which terms add themselves to."""

    layout: Layout
    active: Bool[np.ndarray, " unknowns"]  # the parameters that a step may move
    hessian: Float[np.ndarray, "unknowns unknowns"]  # H
    gradient: Float[np.ndarray, " unknowns"]  # g

    @classmethod
    def zero(cls, layout: Layout, active: Bool[np.ndarray, " unknowns"]) -> Quadratic:
        """Before any term."""
        return cls(layout, active, np.zeros((layout.size, layout.size)), np.zeros(layout.size))

    def add_residuals(
        self,
        jacobian: Float[np.ndarray, "residuals unknowns"],
        weights: Float[np.ndarray, " residuals"],
        residuals: Float[np.ndarray, " residuals"],
    ) -> None:
        """Residuals with fixed weights and their derivatives."""
        # Most columns are those of light and skin, which move no point.
        moving = np.flatnonzero(jacobian.any(axis=0))
        jacobian = jacobian[:, moving]
        self.hessian[np.ix_(moving, moving)] += jacobian.T @ (jacobian * weights[:, None])
        self.gradient[moving] += jacobian.T @ (weights * residuals)


class Weighed(ABC):
    """A term around one state with its weights frozen there: a quadratic model of it."""

    @property
    @abstractmethod
    def energies(self) -> dict[str, float]:
        """Its energies at the state under the frozen weights, by name."""

    @property
    def robust(self) -> dict[str, float]:
        """The energies that the weights come from, of which the model has the gradient."""
        return self.energies

    @abstractmethod
    def add_to(self, total: Quadratic) -> None:
        """Add its normal equations."""

    @abstractmethod
    def decrease(self, state: State, evaluation: Evaluation | None) -> float:
        """How much lower it is at ``state``, under the same weights; -inf where it has no value."""


class Placed(ABC):
    """A term around one state: what it compares is held while derivatives are taken."""

    @abstractmethod
    def weighed(self, state: State) -> Weighed:
        """Its quadratic model at ``state``, which is near the one that it was placed at."""


class Term(ABC):
    """One term of the energy in one phase. Subclasses are frozen: all they depend on is in them."""

    # By the name of each of its energies, in traces and results: what the report calls it.
    words: ClassVar[Mapping[str, str]]
    # Whether it is known before the photo and its landmarks.
    prior: ClassVar[bool] = False

    @classmethod
    @abstractmethod
    def of(cls, setup: Setup) -> Self | None:
        """The term of a phase; None where it has no say."""

    @abstractmethod
    def at(self, state: State, evaluation: Evaluation | None = None) -> Placed | None:
        """The term around ``state``; None where it is silent.

        ``evaluation``: what the model looks like there; None in a phase without a photo.
        """

    def beside_another(self, shared: frozenset[str]) -> Term:
        """The term where another photo of the person carries the priors of ``shared`` blocks."""
        return self
