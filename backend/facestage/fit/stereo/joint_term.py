"""A term between photos of one person: what only several of them together say.

It lives as the terms of one photo do (:mod:`facestage.fit.energy.term`), but in two steps: it is
made for a phase from all photos, and around their states it is placed and weighed at once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.face.joint_layout import JointLayout
from facestage.fit.face.state import State

States = tuple[State, ...]


class JointWeighed(ABC):
    """The term around the photos' states with its weights frozen there: a quadratic model."""

    @property
    @abstractmethod
    def energies(self) -> tuple[dict[str, float], ...]:
        """Each photo's share of the energy under the frozen weights, by name."""

    @abstractmethod
    def add_to(
        self,
        hessian: Float[np.ndarray, "unknowns unknowns"],
        gradient: Float[np.ndarray, " unknowns"],
        layout: JointLayout,
    ) -> None:
        """Add its normal equations to those of the joint vector."""

    @abstractmethod
    def decrease(self, states: States) -> float:
        """How much lower it is at ``states``, the weights unchanged; -inf where it has no value."""


class JointTerm(ABC):
    """One term between the photos of a phase."""

    # By the name of each of its energies, in traces and results: what the report calls it.
    words: ClassVar[Mapping[str, str]]

    @abstractmethod
    def weighed(self, states: States) -> JointWeighed:
        """Around ``states``, at the size of the phase."""
