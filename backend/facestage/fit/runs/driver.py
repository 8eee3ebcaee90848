"""Runs a fit: phases of the schedule over one problem, with checkpoints, progress and a
deadline.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SHAPE, with_unknowns
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.runs.checkpoint import Checkpoint, Within
from facestage.fit.runs.trace import trace_row
from facestage.fit.stages.phases import Phase, Schedule, default_schedule
from facestage.fit.stages.stage import Iteration, Stage
from facestage.fit.stages.view import View
from facestage.fit.trust.checks import Ending, conclude, photo_doubt
from facestage.fit.trust.fitted import Fitted, Progress


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
        self.phases = (schedule or default_schedule(problem.job, problem.fineness.steps_max)).phases
        self.truth, self.listen = truth, listen
        self.trace: list[dict[str, Any]] = []
        self._last: Iteration | None = None
        self._started = 0.0

    def run(self, deadline: float, checkpoint: Checkpoint | None = None) -> Fitted:
        """All phases from the start, or from ``checkpoint``, until done or ``deadline``
        (time.monotonic).
        """
        view, self._started = self.view, time.monotonic()
        state, first, start = view.start_state(), 0, None
        if checkpoint is not None:
            checkpoint.check_fingerprint(self.problem.fingerprint, self.folder)
            state, first, start = checkpoint.began, checkpoint.phase, checkpoint.start
            self.trace = list(checkpoint.trace)
            checkpoint.restore(view)
            self._started -= checkpoint.seconds
        landmarks_end = max(
            (number for number, phase in enumerate(self.phases) if phase.face_px is None),
            default=-1,
        )
        for number in range(first, len(self.phases)):
            # The step that a checkpoint was before is taken whatever the time.
            if time.monotonic() > deadline and number > max(first, 1):
                break
            before = Checkpoint.of(view, number, self._seconds(), start, state, self.trace)
            if checkpoint is not None and number == first:
                before = checkpoint
            state, runs = self._phase(before, deadline)
            if runs and number == landmarks_end:
                start = state
        start = start or state
        psnr = self.trace[-1].get("psnr") if self.trace else None
        clause, statistic = photo_doubt(view, start, state, self._last, psnr)
        if clause:
            state = self._hold_shape(start, state, deadline)
        ending = Ending(self.phases[-1], start, state, self._last, self.trace, clause, statistic)
        ended = time.monotonic()
        return conclude(view, ending, ended - self._started, ended <= deadline)

    def _phase(self, before: Checkpoint, deadline: float) -> tuple[State, bool]:
        """The phase that ``before`` is at the beginning, or in the middle of: where it ends, and
        whether it runs.
        """
        view, number, state = self.view, before.phase, before.began
        phase = self.phases[number]
        view.choose_lamps(state)
        stage = view.solver_stage(phase, state)
        if stage is None:
            return state, False
        if phase.face_px is not None:
            state = view.with_initial_lights(stage, state)
        scaled, step = view.scaled(phase, state), 1
        if before.within is not None:
            scaled, step = before.enter(stage)
            state = view.full_size(phase, scaled, state)
        for item in stage.run(scaled, self.problem.job.seed + number, deadline, step):
            # Where an accepted step began is saved once it is accepted.
            before.save(self.folder)
            state = self._took(phase, item, stage, state)
            within = Within.of(item.number, item.state, item.damping, stage)
            before = before.after(within, view, self._seconds(), self.trace)
            self.listen(self._progress(number, item, stage, state))
        return state, True

    def _took(self, phase: Phase, item: Iteration, stage: Stage, state: State) -> State:
        """A step of ``phase`` from ``state``: the state after it, at the photo's full size, put
        into the trace.
        """
        state, self._last = self.view.full_size(phase, item.state, state), item
        self.trace.append(
            trace_row(self.problem, phase, item, stage, state, self._seconds(), self.truth)
        )
        return state

    def _hold_shape(self, start: State, end: State, deadline: float) -> State:
        """The landmarks' shape with light and skin fitted to it, as far as time allows; not in the
        checkpoint.
        """
        state = with_unknowns(end, start, SHAPE)
        for number, phase in enumerate(self.phases):
            blocks = tuple(name for name in phase.blocks if name not in SHAPE)
            if phase.face_px is None or not blocks or time.monotonic() > deadline:
                continue
            held = replace(phase, name=f"{phase.name}, shape held", blocks=blocks)
            stage = self.view.solver_stage(held, state)
            if stage is None:
                continue
            for item in stage.run(
                self.view.scaled(held, state), self.problem.job.seed + number, deadline
            ):
                state = self._took(held, item, stage, state)
        return state

    def _seconds(self) -> float:
        return time.monotonic() - self._started

    def _progress(self, number: int, item: Iteration, stage: Stage, state: State) -> Progress:
        phase, row = self.phases[number], self.trace[-1]
        done = sum(earlier.share for earlier in self.phases[:number])
        done += phase.share * (1.0 if item.finished else item.number / phase.steps)
        photo = None if stage.energy.photo is None else stage.energy.photo.photo.color
        rms, seconds = row.get("photo_rms"), row["seconds"]
        return Progress(phase.name, item.number, done, seconds, rms, item.evaluation, photo, state)
