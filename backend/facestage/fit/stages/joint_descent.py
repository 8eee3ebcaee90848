"""Several photos of one person as one least-squares problem.

Identity and skin are shared, all else is each photo's own, so the Hessian is an arrow: a block of
shared parameters, a block per photo, and what ties each photo to the shared ones. It is the sum of
the photos' own Hessians, scattered. At the eight photos and 2500 parameters that this is meant for,
one dense factorisation costs less than a ray-traced step of one photo, so nothing is eliminated by
hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from facestage.fit.energy.energy import System
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.face.joint_layout import JointLayout
from facestage.fit.face.unknowns import SHARED
from facestage.fit.solve.bounded_step import Damping
from facestage.fit.solve.covariance import marginal_hessian
from facestage.fit.solve.descent import CONVERGED_SHARE, Descent
from facestage.fit.stages.photo_descent import Iteration, PhotoDescent
from facestage.fit.stereo.joint_term import JointTerm, States

Evaluations = tuple[Evaluation | None, ...]


class JointSystem:
    """The sum of the photos' quadratic models, and of the terms between them."""

    def __init__(
        self,
        layout: JointLayout,
        systems: Sequence[System],
        terms: Sequence[JointTerm],
        state: States,
    ) -> None:
        self.systems = tuple(systems)
        self.between = tuple(term.weighed(state) for term in terms)
        self.hessian = layout.summed([system.hessian for system in systems])
        self.gradient = layout.summed([system.gradient for system in systems])
        # per photo: its energies by name, with its share of those between photos
        self.energies = [dict(system.energies) for system in systems]
        for term in self.between:
            term.add_to(self.hessian, self.gradient, layout)
            for energies, more in zip(self.energies, term.energies, strict=True):
                energies |= more
        self.total = sum(sum(energies.values()) for energies in self.energies)

    def decrease(self, state: States, evaluation: Evaluations) -> float:
        """How much lower the energy of all photos is at ``state``, the weights unchanged."""
        parts = zip(self.systems, state, evaluation, strict=True)
        result = sum(system.decrease(one, answer) for system, one, answer in parts)
        return result + sum(term.decrease(state) for term in self.between)


@dataclass(frozen=True)
class JointIteration:
    """One accepted step of all photos."""

    number: int
    # each photo's, with its own Hessian: what that photo alone would say
    parts: tuple[Iteration, ...]
    damping: Damping
    finished: bool
    hessian: np.ndarray  # (size, size) of the joint system

    def marginal(self, index: int, layout: JointLayout, free: np.ndarray) -> Iteration:
        """Photo ``index``'s part with the Hessian of its parameters when those of the others are
        unknown.

        Its inverse is that photo's block of the joint covariance. ``free`` (size,) bool marks what
        was fitted.
        """
        own, shared = layout.columns[index], layout.columns[index] < layout.shared
        prior = self.parts[index].prior_hessian.copy()
        # The first photo carries the priors of what is shared.
        first = layout.columns[0] < layout.shared
        prior[np.ix_(shared, shared)] = self.parts[0].prior_hessian[np.ix_(first, first)]
        return replace(
            self.parts[index],
            hessian=marginal_hessian(self.hessian, own, free),
            prior_hessian=prior,
        )


class JointDescent(Descent[States, Evaluations, JointSystem, JointIteration]):
    """The solver over all photos in one phase; their shared parameters move as one.

    Noise, robust weights and resting lights are each photo's own; damping and line search see the
    total energy.
    """

    def __init__(self, descents: Sequence[PhotoDescent], terms: Sequence[JointTerm] = ()) -> None:
        """The descents must be of one phase, and hold the same shared parameters; ``terms`` are
        between them.
        """
        self.terms = tuple(terms)
        rest = (descent.beside_another(frozenset(SHARED)) for descent in descents[1:])
        self.descents = (descents[0], *rest)
        self.layout = JointLayout([descent.energy.layout for descent in descents])
        low = self.layout.gathered([descent.low for descent in descents])
        high = self.layout.gathered([descent.high for descent in descents])
        steps, further = (
            max(getattr(descent, name) for descent in descents) for name in ("steps", "further")
        )
        super().__init__(steps, low, high, CONVERGED_SHARE, Damping(), further)

    @property
    def active(self) -> np.ndarray:
        """(size,) bool, the parameters that the phase is about."""
        return self.layout.all_true([descent.active for descent in self.descents])

    def evaluate(self, state: States, seed: int, everything: bool = False) -> Evaluations:
        """Each photo's, one after another."""
        return tuple(
            descent.evaluate(one, seed, everything)
            for descent, one in zip(self.descents, state, strict=True)
        )

    def system(self, state: States, evaluation: Evaluations) -> JointSystem:
        """The sum of the photos' quadratic models, and of the terms between them."""
        parts = zip(self.descents, state, evaluation, strict=True)
        systems = [descent.system(one, answer) for descent, one, answer in parts]
        return JointSystem(self.layout, systems, self.terms, state)

    def settled(self, before: Evaluations, after: Evaluations) -> bool:
        """Whether each photo has."""
        parts = zip(self.descents, before, after, strict=True)
        return all(descent.settled(one, other) for descent, one, other in parts)

    def rest(self, state: States, gradient: np.ndarray) -> None:
        """Each photo's lights are its own."""
        for descent, one, columns in zip(self.descents, state, self.layout.columns, strict=True):
            descent.rest(one, gradient[columns])

    def free(self) -> np.ndarray:
        """What no photo holds."""
        return self.layout.all_true([descent.free() for descent in self.descents])

    def values(self, state: States) -> np.ndarray:
        """The photos' values; the shared ones are equal."""
        return self.layout.gathered(
            [descent.values(one) for descent, one in zip(self.descents, state, strict=True)]
        )

    def moved(self, state: States, step: np.ndarray) -> States:
        """Every photo's state after its part of the step."""
        parts = zip(self.descents, state, self.layout.columns, strict=True)
        return tuple(descent.moved(one, step[columns]) for descent, one, columns in parts)

    def accepted(
        self,
        number: int,
        state: States,
        evaluation: Evaluations,
        system: JointSystem,
        condition: float,
        finished: bool,
    ) -> JointIteration:
        """The step as each photo's own."""
        parts = tuple(
            replace(
                descent.accepted(number, one, answer, own, condition, finished),
                damping=self.damping,
                energy=energies,
            )
            for descent, one, answer, own, energies in zip(
                self.descents, state, evaluation, system.systems, system.energies, strict=True
            )
        )
        return JointIteration(number, parts, self.damping, finished, system.hessian)
