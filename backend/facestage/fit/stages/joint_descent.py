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
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHARED
from facestage.fit.solve.bounded_step import Damping
from facestage.fit.solve.covariance import marginal_hessian
from facestage.fit.solve.descent import CONVERGED_SHARE, Descent
from facestage.fit.stages.photo_descent import Iteration, PhotoDescent

States = tuple[State, ...]
Evaluations = tuple[Evaluation | None, ...]


class JointLayout:
    """Where the parameters of each photo lie in the joint vector: the shared blocks first, then
    photo by photo.
    """

    def __init__(self, layouts: Sequence[Layout]) -> None:
        """Raises ValueError when the photos' shared blocks differ in size."""
        first = layouts[0]
        is_shared = [layout.mask(SHARED) for layout in layouts]
        self.shared = int(is_shared[0].sum())
        for layout in layouts:
            for name in SHARED:
                a, b = layout.slices[name], first.slices[name]
                if a.stop - a.start != b.stop - b.start:
                    raise ValueError(f"The block '{name}' differs in size between the photos.")
        # per photo: (size,) int, the joint index of each of its parameters
        self.columns: list[np.ndarray] = []
        start = self.shared
        for mask in is_shared:
            columns = np.empty(len(mask), int)
            columns[mask] = np.arange(self.shared)
            private = int((~mask).sum())
            columns[~mask] = np.arange(start, start + private)
            start += private
            self.columns.append(columns)
        self.size = start

    def gathered(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """(size,) joint vector of the photos' vectors; of a shared entry, the first photo's."""
        result = np.empty(self.size, parts[0].dtype)
        for columns, part in zip(reversed(self.columns), reversed(parts), strict=True):
            result[columns] = part
        return result

    def all_true(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """(size,) bool, true where every photo that has the entry says so."""
        result = np.ones(self.size, bool)
        for columns, part in zip(self.columns, parts, strict=True):
            result[columns] &= part
        return result

    def summed(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """The photos' vectors (size_k,) or matrices (size_k, size_k), added up in the joint one."""
        result = np.zeros((self.size,) * parts[0].ndim)
        for columns, part in zip(self.columns, parts, strict=True):
            result[np.ix_(*(columns,) * part.ndim)] += part
        return result


class JointSystem:
    """The sum of the photos' quadratic models."""

    def __init__(self, layout: JointLayout, systems: Sequence[System]) -> None:
        self.systems = tuple(systems)
        self.hessian = layout.summed([system.hessian for system in systems])
        self.gradient = layout.summed([system.gradient for system in systems])
        self.total = sum(system.total for system in systems)

    def decrease(self, state: States, evaluation: Evaluations) -> float:
        """How much lower the energy of all photos is at ``state``, the weights unchanged."""
        parts = zip(self.systems, state, evaluation, strict=True)
        return sum(system.decrease(one, answer) for system, one, answer in parts)


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

    def __init__(self, descents: Sequence[PhotoDescent]) -> None:
        """The descents must be of one phase, and hold the same shared parameters."""
        rest = (descent.beside_another(frozenset(SHARED)) for descent in descents[1:])
        self.descents = (descents[0], *rest)
        self.layout = JointLayout([descent.energy.layout for descent in descents])
        low = self.layout.gathered([descent.low for descent in descents])
        high = self.layout.gathered([descent.high for descent in descents])
        super().__init__(
            max(descent.steps for descent in descents), low, high, CONVERGED_SHARE, Damping()
        )

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
        """The sum of the photos' quadratic models."""
        parts = zip(self.descents, state, evaluation, strict=True)
        return JointSystem(
            self.layout, [descent.system(one, answer) for descent, one, answer in parts]
        )

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
            )
            for descent, one, answer, own in zip(
                self.descents, state, evaluation, system.systems, strict=True
            )
        )
        return JointIteration(number, parts, self.damping, finished, system.hessian)
