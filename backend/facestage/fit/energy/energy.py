"""The energy of a phase: the sum of its terms, E_data + w1 E_prior + w2 E_light.

As in Dib et al. 2019, eq. 1. Nobody else adds terms up.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from facestage.contract.arrays import Bool
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.energy.term import Placed, Quadratic, Setup, Term
from facestage.fit.energy.terms import TERMS
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State

T = TypeVar("T", bound=Term)


@dataclass(frozen=True, eq=False)
class Energy:
    """All terms of a phase."""

    layout: Layout
    terms: tuple[Term, ...]

    @classmethod
    def of(cls, setup: Setup) -> Energy:
        """The terms that have a say in a phase."""
        made = (term.of(setup) for term in TERMS)
        return cls(setup.layout, tuple(term for term in made if term is not None))

    @property
    def photo(self) -> PhotoTerm | None:
        """The term that renders; None in a phase of landmarks alone."""
        return next((term for term in self.terms if isinstance(term, PhotoTerm)), None)

    def term(self, kind: type[T]) -> T:
        """The term of this kind. Raises LookupError where it has no say."""
        for term in self.terms:
            if isinstance(term, kind):
                return term
        raise LookupError(f"The energy has no {kind.__name__}.")

    def without(self, kind: type[Term]) -> Energy:
        """The sum of all other terms."""
        return replace(self, terms=tuple(one for one in self.terms if not isinstance(one, kind)))

    def beside_another(self, shared: frozenset[str]) -> Energy:
        """The energy where another photo of the same person carries the priors of ``shared``."""
        return replace(self, terms=tuple(term.beside_another(shared) for term in self.terms))

    def evaluate(
        self, state: State, seed: int, resting: Bool[np.ndarray, " lights"] | None = None
    ) -> Evaluation | None:
        """See :meth:`PhotoTerm.evaluate`; None in a phase of landmarks alone."""
        return None if self.photo is None else self.photo.evaluate(state, seed, resting)

    def at(self, state: State, evaluation: Evaluation | None = None) -> PlacedEnergy:
        """The terms around ``state``."""
        placed = [(term.prior, term.at(state, evaluation)) for term in self.terms]
        return PlacedEnergy(
            self.layout,
            tuple(one for prior, one in placed if prior and one is not None),
            tuple(one for prior, one in placed if not prior and one is not None),
        )


@dataclass(frozen=True, eq=False)
class PlacedEnergy:
    """The terms around one state that are not silent there."""

    layout: Layout
    priors: tuple[Placed, ...]
    data: tuple[Placed, ...]

    def robust(self, state: State) -> dict[str, float]:
        """The energies at ``state`` by name, robust where they are."""
        return _by_name(term.weighed(state).robust for term in (*self.priors, *self.data))

    def system(self, state: State, active: Bool[np.ndarray, " unknowns"] | None = None) -> System:
        """The normal equations at ``state`` for the ``active`` parameters, or all."""
        if active is None:
            active = np.ones(self.layout.size, bool)
        return System(self, state, active)


class System:
    """The quadratic model of all terms around one state, with its weights frozen."""

    def __init__(
        self, placed: PlacedEnergy, state: State, active: Bool[np.ndarray, " unknowns"]
    ) -> None:
        """``active``, the parameters that a step may move."""
        total = Quadratic.zero(placed.layout, active)
        priors, data = (
            [term.weighed(state) for term in terms] for terms in (placed.priors, placed.data)
        )
        for part in priors:
            part.add_to(total)
        self.prior_hessian = total.hessian.copy()
        for part in data:
            part.add_to(total)
        self.hessian, self.gradient = total.hessian, total.gradient
        self.parts = (*priors, *data)
        self.energies = _by_name(part.energies for part in self.parts)
        self.total = sum(self.energies.values())

    @property
    def robust(self) -> dict[str, float]:
        """The energies that the weights come from and that the gradient is of, by name."""
        return _by_name(part.robust for part in self.parts)

    def decrease(self, state: State, evaluation: Evaluation | None) -> float:
        """How much lower it is at ``state``, the weights unchanged; -inf where it has no value."""
        result = 0.0
        for part in self.parts:
            result += part.decrease(state, evaluation)
            if not np.isfinite(result):
                return -np.inf
        return result


def _by_name(energies: Iterable[dict[str, float]]) -> dict[str, float]:
    return {name: value for part in energies for name, value in part.items()}
