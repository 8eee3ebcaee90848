"""The solver over one photo's energy in one phase (Garrido et al. 2016, Algorithm 1)."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass

import numpy as np

from facestage.fit.energy.energy import Energy, System
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.plan import Ledger
from facestage.fit.face.state import State
from facestage.fit.solve.bounded_step import Damping
from facestage.fit.solve.descent import CONVERGED_SHARE, Descent


@dataclass(frozen=True)
class Iteration:
    """One accepted step: what the trace and the progress events are made of."""

    number: int
    state: State
    evaluation: Evaluation | None
    energy: dict[str, float]
    condition: float
    damping: Damping
    finished: bool
    hessian: np.ndarray  # (size, size) of the undamped system that the step was taken from
    prior_hessian: np.ndarray  # (size, size) the priors' part of it

    @property
    def parts(self) -> tuple[Iteration, ...]:
        """The step of each photo: of the only one."""
        return (self,)


class PhotoDescent(Descent[State, Evaluation | None, "System", Iteration]):
    """The solver over some blocks of one photo's parameters."""

    def __init__(
        self,
        name: str,
        blocks: tuple[str, ...],
        energy: Energy,
        steps: int,
        freeze: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        tolerance: float = CONVERGED_SHARE,
        *,
        further: int = 0,
        settled_share: float = 0.0,
    ) -> None:
        """``freeze`` (size,) bool is true where the user, or the plan, holds a parameter; after
        ``steps`` come up to ``further`` ones, while each lowers the residual by ``settled_share``.
        """
        super().__init__(steps, low, high, tolerance, Damping(), further)
        self.settled_share = settled_share
        self.name, self.blocks, self.energy, self.freeze = name, blocks, energy, freeze
        # What the ledger says after the next evaluation, which a run that was stopped has made, and
        # counted, before.
        self.counted: Ledger | None = None
        # (N,) bool, the lights that rest; empty while none was asked.
        self.resting = np.zeros(0, bool)

    @property
    def active(self) -> np.ndarray:
        """(size,) bool, the parameters that the phase is about."""
        return self.energy.layout.mask(self.blocks) & ~self.freeze

    def evaluate(self, state: State, seed: int, everything: bool = False) -> Evaluation | None:
        """None in a phase without the photo."""
        resting = None if everything or not len(self.resting) else self.resting
        evaluation = self.energy.evaluate(state, seed, resting)
        if self.counted is not None and self.energy.photo is not None:
            self.energy.photo.plan.ledger.set_to(self.counted)
            self.counted = None
        return evaluation

    def system(self, state: State, evaluation: Evaluation | None) -> System:
        """The energy's quadratic model."""
        return self.energy.at(state, evaluation).system(state, self.active)

    def settled(self, before: Evaluation | None, after: Evaluation | None) -> bool:
        """Whether the residual fell by less than the share that says so."""
        if before is None or after is None or before.rms is None or after.rms is None:
            return True
        return after.rms > (1 - self.settled_share) * before.rms

    def free(self) -> np.ndarray:
        """The photo does not see a light that rests; the priors alone must not wake it."""
        return self.active & ~self._parameters_at_rest()

    def values(self, state: State) -> np.ndarray:
        """See :meth:`Layout.values`."""
        return self.energy.layout.values(state)

    def moved(self, state: State, step: np.ndarray) -> State:
        """See :meth:`Layout.apply`."""
        return self.energy.layout.apply(state, step)

    def accepted(
        self,
        number: int,
        state: State,
        evaluation: Evaluation | None,
        system: System,
        condition: float,
        finished: bool,
    ) -> Iteration:
        """The step with its system."""
        return Iteration(
            number,
            state,
            evaluation,
            system.energies,
            condition,
            self.damping,
            finished,
            system.hessian,
            system.prior_hessian,
        )

    def resume(self, damping: Damping, resting: np.ndarray, counted: Ledger) -> None:
        """Go on after steps that were taken before: ``resting`` (N,) bool, the lights that rest,
        empty when none was asked yet; ``counted``: what the ledger said.
        """
        self.damping, self.resting, self.counted = damping, resting, counted

    def _parameters_at_rest(self) -> np.ndarray:
        """(size,) bool, the parameters of the lights that rest, color of all lights left out."""
        result = np.zeros(self.energy.layout.size, bool)
        if self.energy.photo is not None and self.resting.any():
            where = self.energy.layout.slices["lights"]
            result[where] = self.energy.photo.forward.lights.of_lights(self.resting)
        return result

    def rest(self, state: State, gradient: np.ndarray) -> None:
        """No light rests in a phase without the photo."""
        photo = self.energy.photo
        if photo is None:
            return
        where = self.energy.layout.slices["lights"]
        settled = (state.lights <= self.low[where]) & (gradient[where] > 0) | ~self.active[where]
        self.resting = photo.forward.lights.dark(state.lights, settled)

    def beside_another(self, shared: frozenset[str]) -> PhotoDescent:
        """A copy where another photo of the same person carries the priors of ``shared``."""
        other = copy(self)
        other.energy = self.energy.beside_another(shared)
        return other
