"""One photo of a person: where its fit stands, and what it does without the others."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHAPE, SHARED, with_unknowns
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.runs.trace import trace_row
from facestage.fit.stages.phases import Phase
from facestage.fit.stages.stage import Iteration, Stage
from facestage.fit.stages.view import View
from facestage.fit.trust.checks import Ending, conclude, photo_doubt
from facestage.fit.trust.fitted import Fitted
from facestage.fit.trust.guard import statistic_limit
from facestage.fit.trust.same_person import Evidence


class MissingStepError(Exception):
    """Something is asked of a photo's last step, which was taken before the checkpoint that the run
    went on from.
    """


# Told of each accepted step: the photo, the number of the phase, the phase, the step and its stage.
Tell = Callable[["Member", int, Phase, Iteration, Stage], None]


@dataclass
class Member:
    """States are at the photo's full size."""

    number: int  # 1, 2, ...
    view: View
    phases: tuple[Phase, ...]
    truth: Truth | None
    state: State
    start: State  # where its own landmark stage ended
    together: State  # where the landmark stage of all photos ended
    trace: list[dict[str, Any]] = field(default_factory=list)
    last: Iteration | None = None
    # ``last`` was before the checkpoint that the run goes on from, and is not known
    missing: bool = False
    joined: bool = True  # takes part in the joint fit
    stranger: bool = False  # left out because its landmarks may be another person's
    doubt: str = ""  # why the photo is not believed about the shape
    # how far the joint fit pulled the shape from the photo's own landmarks', see guard.py
    statistic: float = 0.0

    @property
    def problem(self) -> Problem:
        """The photo's problem."""
        return self.view.problem

    def phase(self, number: int, shape_held: bool) -> Phase:
        """Phase ``number`` of all photos together, with or without the shape."""
        phase = self.phases[number]
        if phase.face_px is None:
            # The name "landmarks" is the photo's own landmark stage's.
            return replace(phase, name=f"{phase.name} together")
        if not shape_held:
            return phase
        return replace(
            phase, name=f"{phase.name}, shape held", blocks=_without(phase.blocks, SHAPE)
        )

    def landmarks_alone(self, tell: Tell) -> Evidence | None:
        """Its own landmark stage; what that says of the identity, where it is fitted and has a
        prior.
        """
        found: tuple[Iteration, Stage] | None = None
        for number, phase in enumerate(self.phases):
            stage = self.view.solver_stage(phase, self.state) if phase.face_px is None else None
            if stage is None:
                continue
            for item in stage.run(self.state, self.problem.job.seed + number, np.inf):
                self.state, found = item.state, (item, stage)
                tell(self, number, phase, item, stage)
        self.start = self.state
        where = Layout(self.state).slices["identity"]
        if found is None or not found[1].active[where].all() or not self.problem.job.weights.prior:
            return None
        return Evidence.of(*found) if where.start < where.stop else None

    def with_initial_lights(self, stage: Stage) -> State:
        """See :meth:`View.with_initial_lights`; an error says which photo it is about."""
        try:
            return self.view.with_initial_lights(stage, self.state)
        except InputError as error:
            raise InputError(
                f"Photo {self.number} ('{self.problem.job.image.name}'): {error}"
            ) from error

    def disbelief(self) -> tuple[float, str]:
        """How little the photo is believed about the shape where it stands, above 0 if not at all,
        and why.
        """
        self._need_last_step()
        psnr = self.trace[-1].get("psnr") if self.trace else None
        clause, self.statistic = photo_doubt(self.view, self.start, self.state, self.last, psnr)
        if not clause:
            return 0.0, ""
        limit = statistic_limit(self.view.free_shape(Layout(self.state)))
        # What no face explains is worse than any distance.
        return (self.statistic / limit if self.statistic > limit else np.inf), clause

    def follow(self, shared: State, deadline: float, tell: Tell) -> None:
        """Take the others' shape and skin; pose and expression by landmarks, and light by the
        photo, are its own.
        """
        state = with_unknowns(self.together, shared, SHARED)
        self.state = replace(state, lights=np.zeros_like(state.lights))
        for number, phase in enumerate(self.phases):
            if phase.face_px is not None and time.monotonic() > deadline:
                return
            blocks = _without(phase.blocks, SHARED if phase.face_px is None else SHARED + SHAPE)
            alone = replace(phase, name=f"{phase.name}, shape shared", blocks=blocks)
            if phase.face_px is not None:
                self.view.choose_lamps(self.state)
            stage = self.view.solver_stage(alone, self.state)
            if stage is None:
                continue
            if phase.face_px is not None:
                self.state = self.with_initial_lights(stage)
            for item in stage.run(
                self.view.scaled(alone, self.state), self.problem.job.seed + number, deadline
            ):
                self.took(alone, item)
                tell(self, number, alone, item, stage)

    def took(self, phase: Phase, item: Iteration) -> None:
        """A step of ``phase``."""
        self.state, self.last, self.missing = (
            self.view.full_size(phase, item.state, self.state),
            item,
            False,
        )

    def record(self, phase: Phase, item: Iteration, stage: Stage, seconds: float) -> None:
        """Add a row to the trace."""
        self.trace.append(
            trace_row(self.problem, phase, item, stage, self.state, seconds, self.truth)
        )

    def concluded(self, shape_held: bool, seconds: float, in_time: bool) -> Fitted:
        """The fit as it ended, see :func:`conclude`."""
        self._need_last_step()
        phase = self.phase(len(self.phases) - 1, shape_held)
        ending = Ending(
            phase, self.start, self.state, self.last, self.trace, self.doubt, self.statistic
        )
        return conclude(self.view, ending, seconds, in_time)

    def _need_last_step(self) -> None:
        if self.missing:
            raise MissingStepError


def _without(blocks: tuple[str, ...], names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in blocks if name not in names)
