"""Runs the fit of several photos of one person: landmarks photo by photo, then all photos as one problem."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.fit.checkpoint import Checkpoint
from facestage.fit.fitted import Fitted, Progress
from facestage.fit.joint import SHARED, JointIteration, JointStage, with_shared
from facestage.fit.joint_checkpoint import JointCheckpoint
from facestage.fit.member import Member
from facestage.fit.parameters import Layout, with_shape
from facestage.fit.phases import SHAPE, Phase, Schedule, default_schedule
from facestage.fit.problem import Problem
from facestage.fit.same_person import Difference, combined, odd_ones
from facestage.fit.schedule import Iteration, Stage
from facestage.fit.shading import ForwardModel
from facestage.fit.solver import Damping
from facestage.fit.truth import Truth
from facestage.fit.view import View


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
            phases = (schedule or default_schedule(problem.job, problem.fineness.steps_max)).phases
            self.members.append(Member(number, view, phases, truth, state, state, state))
        self.phases = self.members[0].phases
        self.folder, self.listen = folder, listen
        # No photo was believed: the shape is the landmarks'.
        self.shape_held = False
        # The last step, for what all photos together say of each one's parameters.
        self._final: tuple[JointStage, JointIteration, list[Member]] | None = None
        self._started, self._deadline, self._fraction = 0.0, np.inf, 0.0
        self._quiet = False  # while what a checkpoint has seen already is done again

    def run(self, deadline: float, checkpoint: JointCheckpoint | None = None) -> JointFitted:
        """All phases from the start, or from ``checkpoint``, until done or ``deadline`` (time.monotonic)."""
        self._started, self._deadline = time.monotonic(), deadline
        first, step = sum(phase.face_px is None for phase in self.phases), 1
        if checkpoint is not None:
            self._check(checkpoint)
            self._started -= checkpoint.photos[0].seconds
        self._quiet = checkpoint is not None
        odd = self._landmarks()
        self._quiet = False
        if checkpoint is not None:
            first, step = self._restore(checkpoint)
        for number in range(first, len(self.phases)):
            if time.monotonic() > deadline:
                break
            self._photo_phase(number, step, checkpoint if step > 1 else None)
            step = 1
        shared = next(member.state for member in self.members if member.joined)
        for member in self.members:
            if not member.joined:
                member.follow(shared, deadline, self._heard_alone)
        self._marginalize_the_last_step()
        ended = time.monotonic()
        seconds, in_time = ended - self._started, ended <= deadline
        concluded = [member.concluded(self.shape_held, seconds, in_time) for member in self.members]
        return JointFitted(tuple(concluded), odd)

    def _landmarks(self) -> dict[int, Difference]:
        """The phases without the photo: each photo alone, then all with one identity; which do not go with the rest.

        Those are left out where at least two others agree.
        """
        evidence = [member.landmarks_alone(self._heard_alone) for member in self.members]
        known = [one for one in evidence if one is not None]
        odd, shared = {}, self.members[0].state
        if len(known) == len(self.members):
            odd = odd_ones(known)
            if len(odd) <= len(known) - 2:
                for index in odd:
                    self.members[index].joined, self.members[index].stranger = False, True
            joined = [one for one, member in zip(known, self.members, strict=True) if member.joined]
            shared = replace(shared, identity=combined(joined)[0])
        for member in self.members:
            member.state = with_shared(member.state, shared)
        for number, phase in enumerate(self.phases):
            if phase.face_px is None and not set(SHARED).isdisjoint(phase.blocks):
                self._descend(number, 1, None)
        for member in self.members:
            member.together = member.state
        return odd

    def _photo_phase(self, number: int, first_step: int, checkpoint: JointCheckpoint | None) -> None:
        """A phase with the photos; again, without the least believed photo, when one is not believed after it."""
        while True:
            final = self._final
            before = [(member, member.state, member.last) for member in self.members if member.joined]
            self._descend(number, first_step, checkpoint)
            leaving = self._least_believed(self.phases[number])
            if leaving is None:
                return
            self._final = final
            for member, state, last in before:
                member.state, member.last = state, last
            leaving.joined = False
            if not any(member.joined for member in self.members):
                # Light and skin are fitted to the landmarks' shape.
                self.shape_held = True
                for member in self.members:
                    if not member.stranger:
                        member.joined, member.state = True, with_shape(member.state, member.together)
            first_step, checkpoint = 1, None

    def _descend(self, number: int, first_step: int, checkpoint: JointCheckpoint | None) -> None:
        """All photos that take part, through phase ``number`` together; ``checkpoint`` if it was left in the middle."""
        joined = [member for member in self.members if member.joined]
        phases = {member.number: member.phase(number, self.shape_held) for member in joined}
        found = {member.number: self._stage(member, phases[member.number], first_step) for member in joined}
        stages = {photo: stage for photo, stage in found.items() if stage is not None}
        joined = [member for member in joined if member.number in stages]
        if not joined:
            return
        joint = JointStage(list(stages.values()))
        if checkpoint is not None:
            joint.damping = Damping(*checkpoint.photos[0].damping)
            for photo, stage in stages.items():
                checkpoint.photos[photo - 1].restore_stage(stage)
        scaled = tuple(member.view.scaled(phases[member.number], member.state) for member in joined)
        for item in joint.run(scaled, joined[0].problem.job.seed + number, self._deadline, first_step):
            self._final = (joint, item, joined)
            for member, part in zip(joined, item.parts, strict=True):
                phase = phases[member.number]
                member.state, member.last = member.view.full_size(phase, part.state, member.state), part
                if not self._quiet:
                    member.record(phase, part, stages[member.number], time.monotonic() - self._started)
            if phases[joined[0].number].face_px is not None:
                self._save(number, item, stages)
            # Each step shows another photo.
            shown = item.number % len(joined)
            photo = joined[shown].number
            self._tell(joined[shown], number, phases[photo], item.parts[shown], stages[photo], together=True)

    def _stage(self, member: Member, phase: Phase, first_step: int) -> Stage | None:
        """A photo's stage for a phase, with its lamps chosen and lit at the phase's first step."""
        starts = first_step == 1 and phase.face_px is not None
        if starts:
            member.view.choose_lamps(member.state)
        stage = member.view.solver_stage(phase, member.state)
        if stage is not None and starts:
            member.state = member.with_initial_lights(stage)
        return stage

    def _least_believed(self, phase: Phase) -> Member | None:
        """Of the photos that take part, the one that is least believed about the shape, if any is not."""
        if self.shape_held or set(SHAPE).isdisjoint(phase.blocks):
            return None
        found = [(member, *member.disbelief()) for member in self.members if member.joined]
        worst, disbelief, clause = max(found, key=lambda one: one[1])
        if not disbelief:
            return None
        worst.doubt = clause
        return worst

    def _marginalize_the_last_step(self) -> None:
        """Each photo's last step with what all photos together say of its parameters."""
        if self._final is None:
            return
        joint, item, joined = self._final
        free = joint.layout.all_true([~member.view.held(Layout(member.state)) for member in joined])
        for index, member in enumerate(joined):
            if member.joined:
                member.last = item.marginal(index, joint.layout, free)

    def _heard_alone(self, member: Member, number: int, phase: Phase, item: Iteration, stage: Stage) -> None:
        """A step that a photo took without the others."""
        if not self._quiet:
            member.record(phase, item, stage, time.monotonic() - self._started)
        self._tell(member, number, phase, item, stage, together=False)

    def _tell(
        self, member: Member, number: int, phase: Phase, item: Iteration, stage: Stage, together: bool
    ) -> None:  # fmt: skip
        if self._quiet:
            return
        if together:
            done = sum(earlier.share for earlier in self.phases[:number])
            done += phase.share * (1.0 if item.finished else item.number / phase.steps)
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
        seconds = time.monotonic() - self._started
        photos = []
        for member in self.members:
            stage = stages.get(member.number)
            photos.append(
                Checkpoint.of(member.view, phase, step, item.damping, seconds, member.state, member.trace, stage)
            )
        doubts = tuple(member.doubt for member in self.members)
        joined = tuple(member.joined for member in self.members)
        JointCheckpoint(tuple(photos), doubts, joined, self.shape_held).save(self.folder)

    def _check(self, checkpoint: JointCheckpoint) -> None:
        """Raise InputError unless ``checkpoint`` is of these photos."""
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
