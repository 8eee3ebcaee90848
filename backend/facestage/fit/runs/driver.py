"""Runs a fit: phases of the schedule over one problem, with checkpoints, progress and a
deadline.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHAPE, with_unknowns
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.runs.checkpoint import Checkpoint
from facestage.fit.runs.progress import Progress, Scale
from facestage.fit.runs.trace import trace_row
from facestage.fit.stages.passage import Passage, walk
from facestage.fit.stages.phases import SHAPE_HELD, Phase, Schedule, default_schedule
from facestage.fit.stages.photo_descent import Iteration
from facestage.fit.stages.teeth_height import with_teeth_seen
from facestage.fit.stages.view import View
from facestage.fit.trust.checks import Ending, conclude, photo_doubt
from facestage.fit.trust.fitted import Fitted


class FitRun:
    """One fit.

    ``folder`` keeps the checkpoint; ``listen`` hears of each step; the clock is monotonic.
    """

    def __init__(
        self,
        problem: Problem,
        forward: ForwardModel,
        folder: Path,
        truth: Truth | None = None,
        listen: Callable[[Progress], None] = lambda progress: None,
        schedule: Schedule | None = None,
    ) -> None:
        self.problem, self.folder = problem, folder
        self.view = View(problem, forward)
        self.schedule = schedule or default_schedule(problem.job, problem.fineness.steps_max)
        self._scale = Scale(self.schedule)
        self.truth, self.listen = truth, listen
        self.trace: list[dict[str, Any]] = []
        self._last: Iteration | None = None
        self._started = 0.0

    def run(self, deadline: float, checkpoint: Checkpoint | None = None) -> Fitted:
        """All phases from the start, or from ``checkpoint``, until done or ``deadline``
        (time.monotonic).
        """
        view, self._started = self.view, time.monotonic()
        state, rest, start = view.start_state(), self.schedule, None
        if checkpoint is not None:
            checkpoint.check(self.problem.fingerprint, self.schedule, self.folder)
            state, start = checkpoint.began, checkpoint.start
            rest = self.schedule.since(checkpoint.phase)
            self.trace = list(checkpoint.trace)
            view = self.view = checkpoint.restored(view)
            self._started -= checkpoint.seconds
        for phase in rest.phases:
            before = checkpoint if checkpoint and checkpoint.phase == phase.name else None
            if phase.with_photo:
                # The step that a checkpoint was before is taken whatever the time.
                if before is None and time.monotonic() > deadline:
                    break
                if start is None:
                    view = self.view = view.lit(phase, state)
                    start = state = view.unlit(state)
                    if view.problem.added:
                        self._last = None  # was of fewer lights
            if before is None:
                seconds = self._seconds()
                before = Checkpoint.of(view, phase.name, seconds, start, state, self.trace)
            state = self._phase(phase, before, deadline)
        start = start or state
        psnr = self.trace[-1].get("psnr") if self.trace else None
        clause, statistic = photo_doubt(view, start, state, self._last, psnr)
        if clause:
            state = self._hold_shape(start, state, deadline)
        (state,) = with_teeth_seen([(view, state)])
        ending = Ending(self.schedule.last, start, state, self._last, self.trace, clause, statistic)
        ended = time.monotonic()
        return conclude(view, ending, ended - self._started, ended <= deadline)

    def _phase(self, phase: Phase, before: Checkpoint, deadline: float) -> State:
        """Where ``phase`` ends, which ``before`` is at the beginning of, or in the middle."""
        passage = Passage.prepared(self.view, phase, before.began)
        if passage is None:
            return before.began
        if before.within is not None:
            passage.enter(before.within, before.ledger)
        for item in passage.steps(deadline):
            # Where an accepted step began is saved once it is accepted.
            before.save(self.folder)
            self._took(passage, item)
            before = before.after(passage.within(item), self.view, self._seconds(), self.trace)
            fraction = self._scale.after(passage, item)
            self.listen(Progress.of(passage, item, self.trace[-1], fraction))
        return passage.state

    def _took(self, passage: Passage, item: Iteration) -> None:
        """Put a step into the trace."""
        self._last = item
        self.trace.append(trace_row(passage, item, self._seconds(), self.truth))

    def _hold_shape(self, start: State, end: State, deadline: float) -> State:
        """The landmarks' shape with light and skin fitted to it, as far as time allows; not in the
        checkpoint.
        """
        held = [phase.varied(SHAPE_HELD, SHAPE) for phase in self.schedule.photo_phases]
        state = with_unknowns(end, start, SHAPE)
        return walk(self.view, held, state, deadline, self._took, keep_light=True)

    def _seconds(self) -> float:
        return time.monotonic() - self._started
