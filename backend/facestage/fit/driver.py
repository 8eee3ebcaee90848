"""Runs a fit: phases of the schedule over one problem, with checkpoints, progress and a deadline."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from facestage.fit.checkpoint import Checkpoint
from facestage.fit.checks import Ending, conclude, photo_doubt
from facestage.fit.fitted import Fitted, Progress
from facestage.fit.parameters import State, with_shape
from facestage.fit.phases import SHAPE, Schedule, default_schedule
from facestage.fit.problem import Problem
from facestage.fit.schedule import Iteration, Stage
from facestage.fit.shading import ForwardModel
from facestage.fit.solver import Damping
from facestage.fit.trace import trace_row
from facestage.fit.truth import Truth
from facestage.fit.view import View


class FitRun:
    """One fit. ``folder`` keeps the checkpoint; ``listen`` hears of each step; the clock is monotonic."""

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

    def run(self, deadline: float, checkpoint: Checkpoint | None = None) -> Fitted:
        """All phases from the start, or from ``checkpoint``, until done or ``deadline`` (time.monotonic)."""
        view, started = self.view, time.monotonic()
        state, first_phase, first_step, damping = view.start_state(), 0, 1, Damping()
        if checkpoint is not None:
            checkpoint.check_fingerprint(self.problem.fingerprint, self.folder)
            state, first_phase, first_step = checkpoint.state, checkpoint.phase, checkpoint.step + 1
            damping = Damping(*checkpoint.damping)
            self.trace = list(checkpoint.trace)
            checkpoint.restore(view)
            started -= checkpoint.seconds
        last: Iteration | None = None
        landmarks_only = [number for number, phase in enumerate(self.phases) if phase.face_px is None]
        start = self._landmark_state() if first_phase > max(landmarks_only, default=-1) else None
        for number in range(first_phase, len(self.phases)):
            phase = self.phases[number]
            if time.monotonic() > deadline and number > 1:
                break
            if first_step == 1:
                view.choose_lamps(state)
            stage = view.solver_stage(phase, state)
            if stage is None:
                continue
            if phase.face_px is not None and first_step == 1:
                state = view.with_initial_lights(stage, state)
            if number == first_phase and first_step > 1 and checkpoint is not None:
                stage.damping = damping
                checkpoint.restore_stage(stage)
            for item in stage.run(view.scaled(phase, state), self.problem.job.seed + number, deadline, first_step):
                state, last = view.full_size(phase, item.state, state), item
                seconds = time.monotonic() - started
                self.trace.append(trace_row(self.problem, phase, item, stage, state, seconds, self.truth))
                self._save(number, item, state, seconds, stage)
                self.listen(self._progress(number, item, stage, state, seconds))
            first_step = 1
            if number == max(landmarks_only, default=-1):
                start = state
        start = start or state
        clause, statistic = photo_doubt(view, start, state, last, self.trace[-1].get("psnr") if self.trace else None)
        if clause:
            state, last = self._hold_shape(start, state, last, deadline, started)
        ending = Ending(self.phases[-1], start, state, last, self.trace, clause, statistic)
        ended = time.monotonic()
        return conclude(view, ending, ended - started, ended <= deadline)

    def _landmark_state(self) -> State:
        """Where the phases without the photo end, for a run that was resumed after them."""
        state = self.view.start_state()
        for number, phase in enumerate(self.phases):
            stage = self.view.solver_stage(phase, state) if phase.face_px is None else None
            if stage is not None:
                for item in stage.run(state, self.problem.job.seed + number, np.inf):
                    state = item.state
        return state

    def _hold_shape(
        self, start: State, end: State, last: Iteration | None, deadline: float, started: float
    ) -> tuple[State, Iteration | None]:
        """The landmarks' shape with light and skin fitted to it, as far as time allows; not in the checkpoint."""
        state = with_shape(end, start)
        for number, phase in enumerate(self.phases):
            blocks = tuple(name for name in phase.blocks if name not in SHAPE)
            if phase.face_px is None or not blocks or time.monotonic() > deadline:
                continue
            held = replace(phase, name=f"{phase.name}, shape held", blocks=blocks)
            stage = self.view.solver_stage(held, state)
            if stage is None:
                continue
            for item in stage.run(self.view.scaled(held, state), self.problem.job.seed + number, deadline):
                state, last = self.view.full_size(held, item.state, state), item
                seconds = time.monotonic() - started
                self.trace.append(trace_row(self.problem, held, item, stage, state, seconds, self.truth))
        return state, last

    def _save(self, number: int, item: Iteration, state: State, seconds: float, stage: Stage) -> None:
        phase, step = (number + 1, 0) if item.finished else (number, item.number)
        Checkpoint.of(self.view, phase, step, item.damping, seconds, state, self.trace, stage).save(self.folder)

    def _progress(self, number: int, item: Iteration, stage: Stage, state: State, seconds: float) -> Progress:
        phase = self.phases[number]
        done = sum(earlier.share for earlier in self.phases[:number])
        done += phase.share * (1.0 if item.finished else item.number / phase.steps)
        photo = None if stage.energy.photo is None else stage.energy.photo.photo.color
        rms = self.trace[-1].get("photo_rms")
        return Progress(phase.name, item.number, done, seconds, rms, item.evaluation, photo, state)
