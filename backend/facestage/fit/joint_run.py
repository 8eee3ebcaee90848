"""Runs the fit of several photos of one person: landmarks photo by photo, then all photos as one problem."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.fit.checkpoint import Checkpoint
from facestage.fit.checks import Ending, conclude, photo_doubt
from facestage.fit.fitted import Fitted, Progress
from facestage.fit.guard import statistic_limit
from facestage.fit.joint import SHARED, JointIteration, JointStage, with_shared
from facestage.fit.joint_checkpoint import JointCheckpoint
from facestage.fit.parameters import Layout, State, with_shape
from facestage.fit.phases import SHAPE, Phase, Schedule, default_schedule
from facestage.fit.problem import Problem
from facestage.fit.same_person import Difference, Evidence, combined, odd_ones
from facestage.fit.schedule import Iteration, Stage
from facestage.fit.shading import ForwardModel
from facestage.fit.solver import Damping
from facestage.fit.trace import trace_row
from facestage.fit.truth import Truth
from facestage.fit.view import View


@dataclass
class Member:
    """One photo of a person, and where its fit stands."""

    number: int  # 1, 2, ...
    view: View
    phases: tuple[Phase, ...]
    truth: Truth | None
    state: State
    start: State  # where its own landmark stage ended
    together: State  # where the landmark stage of all photos ended
    trace: list[dict[str, Any]] = field(default_factory=list)
    last: Iteration | None = None
    joined: bool = True  # takes part in the joint fit
    doubt: str = ""  # why the photo is not believed about the shape
    statistic: float = 0.0  # how far the joint fit pulled the shape from the photo's own landmarks', see guard.py

    @property
    def problem(self) -> Problem:
        """The photo's problem."""
        return self.view.problem


@dataclass(frozen=True)
class JointProgress:
    """What a listener hears: a step of one photo alone, or of all photos together, told by one of them."""

    photo: int  # 1, 2, ...
    together: bool
    progress: Progress


@dataclass(frozen=True)
class JointFitted:
    """Where the schedule ended for each photo, and which of them do not go with the rest (by index)."""

    photos: tuple[Fitted, ...]
    odd: dict[int, Difference]


class JointRun:
    """One fit of several photos. ``folder`` keeps the checkpoint; ``listen`` hears of each step."""

    def __init__(
        self,
        problems: Sequence[Problem],
        forwards: Sequence[ForwardModel],
        folder: Path,
        truths: Sequence[Truth | None],
        listen: Callable[[JointProgress], None] = lambda progress: None,
        schedule: Schedule | None = None,
    ) -> None:
        """One problem, renderer and truth per photo; the problems share one face geometry."""
        self.members = []
        for number, (problem, forward, truth) in enumerate(zip(problems, forwards, truths, strict=True), 1):
            view = View(problem, forward)
            state = view.start_state()
            phases = (schedule or default_schedule(problem.job)).phases
            self.members.append(Member(number, view, phases, truth, state, state, state))
        self.phases = self.members[0].phases
        self.folder, self.listen = folder, listen
        self.shape_held = False
        self._final: tuple[JointStage, JointIteration, list[Member]] | None = None
        self._started, self._deadline, self._fraction = 0.0, np.inf, 0.0

    def run(self, deadline: float, checkpoint: JointCheckpoint | None = None) -> JointFitted:
        """All phases from the start, or from ``checkpoint``, until done or ``deadline`` (time.monotonic)."""
        self._started, self._deadline = time.monotonic(), deadline
        if checkpoint is not None:
            self._check(checkpoint)
            self._started -= checkpoint.photos[0].seconds
        odd = self._landmarks(quiet=checkpoint is not None)
        first, step = sum(phase.face_px is None for phase in self.phases), 1
        if checkpoint is not None:
            first, step = self._restore(checkpoint)
        for number in range(first, len(self.phases)):
            if time.monotonic() > deadline:
                break
            self._phase(number, step, checkpoint if step > 1 else None)
            step = 1
        for member in self.members:
            if not member.joined:
                self._follow(member)
        self._marginalize_the_last_step()
        return JointFitted(tuple(self._concluded(member) for member in self.members), odd)

    def _landmarks(self, quiet: bool) -> dict[int, Difference]:
        """The phases without the photo: each photo alone, then all with one identity; who does not go with the rest."""
        evidence = [self._landmarks_alone(member, quiet) for member in self.members]
        known = [one for one in evidence if one is not None]
        odd = {}
        if len(known) == len(self.members):
            odd = odd_ones(known)
            identity = combined(known)[0]
        else:
            identity = self.members[0].state.identity
        shared = replace(self.members[0].state, identity=identity)
        for member in self.members:
            member.state = with_shared(member.state, shared)
        for number, phase in enumerate(self.phases):
            if phase.face_px is None and not set(SHARED).isdisjoint(phase.blocks):
                self._descend(number, 1, None, quiet)
        for member in self.members:
            member.together = member.state
        return odd

    def _landmarks_alone(self, member: Member, quiet: bool) -> Evidence | None:
        """A photo's own landmark stage; what it says of the identity, where that is fitted and has a prior."""
        view, last, free = member.view, None, np.zeros(0, bool)
        for number, phase in enumerate(member.phases):
            stage = view.solver_stage(phase, member.state) if phase.face_px is None else None
            if stage is None:
                continue
            for item in stage.run(member.state, view.problem.job.seed + number, np.inf):
                member.state, last, free = item.state, item, stage.active
                if not quiet:
                    self._record(phase, member, item, stage)
                    self._tell(phase, number, member, item, stage, together=False)
        member.start = member.state
        where = Layout(member.state).slices["identity"]
        if last is None or not free[where].all() or not view.problem.job.weights.prior or where.start == where.stop:
            return None
        return Evidence.of(last, free)

    def _phase(self, number: int, first_step: int, checkpoint: JointCheckpoint | None) -> None:
        """A phase with the photos; again, without the least believed photo, when one is not believed after it."""
        while True:
            before = [(member, member.state, member.last) for member in self.members if member.joined]
            final = self._final
            self._descend(number, first_step, checkpoint)
            leaving = self._least_believed(self.phases[number])
            if leaving is None:
                return
            self._final = final
            for member, state, last in before:
                member.state, member.last = state, last
            leaving.joined = False
            if not any(member.joined for member in self.members):
                # The landmarks' shape, with light and skin fitted to it.
                self.shape_held = True
                for member in self.members:
                    member.joined, member.state = True, with_shape(member.state, member.together)
            first_step, checkpoint = 1, None

    def _descend(
        self, number: int, first_step: int, checkpoint: JointCheckpoint | None, quiet: bool = False
    ) -> None:  # fmt: skip
        """All photos that take part, through phase ``number`` together."""
        joined, stages = [], []
        for member in self.members:
            phase = self._of(member, number)
            if not member.joined:
                continue
            if first_step == 1 and phase.face_px is not None:
                member.view.choose_lamps(member.state)
            stage = member.view.solver_stage(phase, member.state)
            if stage is None:
                continue
            if first_step == 1 and phase.face_px is not None:
                member.state = self._with_initial_lights(member, stage)
            if checkpoint is not None:
                checkpoint.photos[member.number - 1].restore_stage(stage)
            joined.append(member)
            stages.append(stage)
        if not stages:
            return
        joint = JointStage(stages)
        if checkpoint is not None:
            joint.damping = Damping(*checkpoint.photos[0].damping)
        scaled = tuple(member.view.scaled(self._of(member, number), member.state) for member in joined)
        for item in joint.run(scaled, self.members[0].problem.job.seed + number, self._deadline, first_step):
            for member, stage, part in zip(joined, stages, item.parts, strict=True):
                phase = self._of(member, number)
                member.state, member.last = member.view.full_size(phase, part.state, member.state), part
                if not quiet:
                    self._record(phase, member, part, stage)
            self._final = (joint, item, joined)
            if self._of(joined[0], number).face_px is not None:
                self._save(number, item, dict(zip((member.number for member in joined), stages, strict=True)))
            if not quiet:
                # Each step shows another photo.
                shown = item.number % len(joined)
                one = joined[shown]
                self._tell(self._of(one, number), number, one, item.parts[shown], stages[shown], together=True)

    def _of(self, member: Member, number: int) -> Phase:
        """Phase ``number`` for a photo."""
        phase = member.phases[number]
        if phase.face_px is None:
            # The name "landmarks" is the photo's own landmark stage's.
            return replace(phase, name=f"{phase.name} together")
        if not self.shape_held:
            return phase
        blocks = tuple(name for name in phase.blocks if name not in SHAPE)
        return replace(phase, name=f"{phase.name}, shape held", blocks=blocks)

    def _with_initial_lights(self, member: Member, stage: Stage) -> State:
        try:
            return member.view.with_initial_lights(stage, member.state)
        except InputError as error:
            raise InputError(f"Photo {member.number} ({member.problem.job.image.name}): {error}") from error

    def _least_believed(self, phase: Phase) -> Member | None:
        """Of the photos that take part, the one that is least believed about the shape, if any is not."""
        if self.shape_held or set(SHAPE).isdisjoint(phase.blocks):
            return None
        worst, excess, why = None, 0.0, ""
        for member in self.members:
            if not member.joined:
                continue
            psnr = member.trace[-1].get("psnr") if member.trace else None
            clause, member.statistic = photo_doubt(member.view, member.start, member.state, member.last, psnr)
            limit = statistic_limit(member.view.free_shape(Layout(member.state)))
            # What no face explains is worse than any distance.
            badness = 0.0 if not clause else member.statistic / limit if member.statistic > limit else np.inf
            if badness > excess:
                worst, excess, why = member, badness, clause
        if worst is not None:
            worst.doubt = why
        return worst

    def _follow(self, member: Member) -> None:
        """A photo that is not believed takes the others' shape and skin; pose, expression and light are its own."""
        shared = next(other for other in self.members if other.joined)
        member.state = with_shared(member.together, shared.state)
        member.state = replace(member.state, lights=np.zeros_like(member.state.lights))
        for number, phase in enumerate(member.phases):
            own = set(phase.blocks) - set(SHARED)
            blocks = tuple(
                name for name in phase.blocks if name in (own if phase.face_px is None else own - set(SHAPE))
            )
            alone = replace(phase, name=f"{phase.name}, shape shared", blocks=blocks)
            if number > 1 and time.monotonic() > self._deadline:
                return
            if phase.face_px is not None:
                member.view.choose_lamps(member.state)
            stage = member.view.solver_stage(alone, member.state) if blocks else None
            if stage is None:
                continue
            if phase.face_px is not None:
                member.state = self._with_initial_lights(member, stage)
            scaled = member.view.scaled(alone, member.state)
            for item in stage.run(scaled, member.problem.job.seed + number, self._deadline):
                member.state, member.last = member.view.full_size(alone, item.state, member.state), item
                self._record(alone, member, item, stage)
                self._tell(alone, number, member, item, stage, together=False)

    def _marginalize_the_last_step(self) -> None:
        """Each photo's last step with what all photos together say of its parameters."""
        if self._final is None:
            return
        joint, item, joined = self._final
        free = joint.layout.all_true([~member.view.held(Layout(member.state)) for member in joined])
        for index, member in enumerate(joined):
            if member.joined:
                member.last = item.marginal(index, joint.layout, free)

    def _concluded(self, member: Member) -> Fitted:
        ending = Ending(
            self._of(member, len(self.phases) - 1), member.start, member.state, member.last, member.trace,
            member.doubt, member.statistic,
        )  # fmt: skip
        return conclude(member.view, ending, self._started, self._deadline)

    def _record(self, phase: Phase, member: Member, item: Iteration, stage: Stage) -> None:
        seconds = time.monotonic() - self._started
        member.trace.append(trace_row(member.problem, phase, item, stage, member.state, seconds, member.truth))

    def _tell(
        self, phase: Phase, number: int, member: Member, item: Iteration, stage: Stage, together: bool
    ) -> None:  # fmt: skip
        share = phase.share * (1.0 if item.finished else item.number / phase.steps)
        if together:
            done = sum(earlier.share for earlier in self.phases[:number]) + share
        else:
            landmarks = sum(one.share for one in self.phases if one.face_px is None)
            done = landmarks * (member.number - 1) / len(self.members)
        # What is done again is no step back.
        self._fraction = max(self._fraction, done)
        photo = None if stage.energy.photo is None else stage.energy.photo.photo.color
        row = member.trace[-1]
        progress = Progress(
            phase.name, item.number, self._fraction, row["seconds"], row.get("photo_rms"), item.evaluation, photo,
            member.state,
        )  # fmt: skip
        self.listen(JointProgress(member.number, together, progress))

    def _save(self, number: int, item: JointIteration, stages: dict[int, Stage]) -> None:
        """``stages`` by the number of the photo."""
        phase, step = (number + 1, 0) if item.finished else (number, item.number)
        seconds, members = time.monotonic() - self._started, self.members
        photos = [
            Checkpoint.of(
                member.view, phase, step, item.damping, seconds, member.state, member.trace, stages.get(member.number)
            )
            for member in members
        ]
        doubts, joined = tuple(one.doubt for one in members), tuple(one.joined for one in members)
        JointCheckpoint(tuple(photos), doubts, joined, self.shape_held).save(self.folder)

    def _check(self, checkpoint: JointCheckpoint) -> None:
        if len(checkpoint.photos) != len(self.members):
            raise InputError(
                f"The checkpoint in '{self.folder}' is of {len(checkpoint.photos)} photos, and {len(self.members)} "
                "were given; give the same photos in the same order, or start again without --resume."
            )
        for photo, member in zip(checkpoint.photos, self.members, strict=True):
            photo.check_fingerprint(member.problem.fingerprint, self.folder)

    def _restore(self, checkpoint: JointCheckpoint) -> tuple[int, int]:
        """Phase and step to go on with."""
        self.shape_held = checkpoint.shape_held
        for index, (photo, member) in enumerate(zip(checkpoint.photos, self.members, strict=True)):
            photo.restore(member.view)
            member.state, member.trace = photo.state, list(photo.trace)
            member.joined, member.doubt = checkpoint.joined[index], checkpoint.doubts[index]
        return checkpoint.photos[0].phase, checkpoint.photos[0].step + 1
