"""Runs the fit of several photos of one person: landmarks photo by photo, then all photos as one
problem.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.fit.face.layout import Layout
from facestage.fit.face.unknowns import SHAPE, SHARED, with_unknowns
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.runs.joint_checkpoint import JointCheckpoint
from facestage.fit.runs.joint_progress import JointProgress, Teller
from facestage.fit.runs.member import Member, MissingStepError
from facestage.fit.solve.bounded_step import Damping
from facestage.fit.stages.joint import JointIteration, JointStage
from facestage.fit.stages.phases import Phase, Schedule, default_schedule
from facestage.fit.stages.stage import Iteration, Stage
from facestage.fit.stages.view import View
from facestage.fit.trust.fitted import Fitted
from facestage.fit.trust.same_person import Difference, combined, odd_ones


@dataclass(frozen=True)
class JointFitted:
    """Where the schedule ended for each photo, and which of them do not go with the rest (by
    index).
    """

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
        self._given = tuple(zip(problems, forwards, truths, strict=True))
        self._schedule = schedule
        self.members = self._new_members()
        self.phases = self.members[0].phases
        self.folder = folder
        # No photo was believed: the shape is the landmarks'.
        self.shape_held = False
        # The last step, for what all photos together say of each one's parameters.
        self._final: tuple[JointStage, JointIteration, list[Member]] | None = None
        self._started, self._deadline = 0.0, np.inf
        self._teller = Teller(listen, self.phases, len(self.members))

    def run(self, deadline: float, checkpoint: JointCheckpoint | None = None) -> JointFitted:
        """All phases from the start, or from ``checkpoint``, until done or ``deadline``
        (time.monotonic).
        """
        if checkpoint is not None:
            self._check(checkpoint)
            try:
                return self._run(deadline, checkpoint)
            except MissingStepError:
                # A photo took no step after it left the others, and its last one was before the
                # checkpoint: rare enough to begin anew, which ends at the same place.
                self.members, self.shape_held, self._final = self._new_members(), False, None
        return self._run(deadline, None)

    def _new_members(self) -> list[Member]:
        members = []
        for number, (problem, forward, truth) in enumerate(self._given, 1):
            view = View(problem, forward)
            state = view.start_state()
            phases = (
                self._schedule or default_schedule(problem.job, problem.fineness.steps_max)
            ).phases
            members.append(Member(number, view, phases, truth, state, state, state))
        return members

    def _run(self, deadline: float, checkpoint: JointCheckpoint | None) -> JointFitted:
        self._started, self._deadline = time.monotonic(), deadline
        if checkpoint is not None:
            self._started -= checkpoint.photos[0].seconds
        self._teller.quiet = checkpoint is not None
        odd = self._landmarks()
        self._teller.quiet = False
        first = sum(phase.face_px is None for phase in self.phases)
        if checkpoint is not None:
            self._restore(checkpoint, first)
            # The step that a checkpoint was before is taken whatever the time.
            first = checkpoint.photos[0].phase
            self._photo_phase(first, checkpoint)
            first += 1
        for number in range(first, len(self.phases)):
            if time.monotonic() > deadline:
                break
            self._photo_phase(number, None)
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
        """The phases without the photo: each photo alone, then all with one identity; which do not
        go with the rest.

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
            member.state = with_unknowns(member.state, shared, SHARED)
        for number, phase in enumerate(self.phases):
            if phase.face_px is None and not set(SHARED).isdisjoint(phase.blocks):
                self._descend(number, None)
        for member in self.members:
            member.together = member.state
        return odd

    def _photo_phase(self, number: int, checkpoint: JointCheckpoint | None) -> None:
        """A phase with the photos; again, without the least believed photo, when one is not
        believed after it.
        """
        while True:
            final = self._final
            before = [
                (member, member.state, member.last, member.missing)
                for member in self.members
                if member.joined
            ]
            self._descend(number, checkpoint)
            leaving = self._least_believed(self.phases[number])
            if leaving is None:
                return
            self._final = final
            for member, state, last, missing in before:
                member.state, member.last, member.missing = state, last, missing
            leaving.joined = False
            if not any(member.joined for member in self.members):
                # Light and skin are fitted to the landmarks' shape.
                self.shape_held = True
                for member in self.members:
                    if not member.stranger:
                        member.joined, member.state = (
                            True,
                            with_unknowns(member.state, member.together, SHAPE),
                        )
            checkpoint = None

    def _descend(self, number: int, checkpoint: JointCheckpoint | None) -> None:
        """All photos that take part, through phase ``number`` together; from ``checkpoint`` if it
        was left there.
        """
        before = checkpoint or JointCheckpoint.of(
            self.members, number, self._seconds(), self.shape_held
        )
        joined = [member for member in self.members if member.joined]
        phases = {member.number: member.phase(number, self.shape_held) for member in joined}
        found = {member.number: self._stage(member, phases[member.number]) for member in joined}
        stages = {photo: stage for photo, stage in found.items() if stage is not None}
        joined = [member for member in joined if member.number in stages]
        if not joined:
            return
        joint = JointStage(list(stages.values()))
        scaled, step = [], 1
        for member in joined:
            phase, own = phases[member.number], before.photos[member.number - 1]
            scaled.append(member.view.scaled(phase, member.state))
            if own.within is not None:
                scaled[-1], step = own.enter(stages[member.number])
                member.state = member.view.full_size(phase, scaled[-1], member.state)
                joint.damping = Damping(*own.within.damping)
        for item in joint.run(
            tuple(scaled), joined[0].problem.job.seed + number, self._deadline, step
        ):
            # Where an accepted step began is saved once it is accepted; landmarks are done again.
            if self.phases[number].face_px is not None:
                before.save(self.folder)
            self._final = (joint, item, joined)
            for member, part in zip(joined, item.parts, strict=True):
                member.took(phases[member.number], part)
                if not self._teller.quiet:
                    member.record(
                        phases[member.number], part, stages[member.number], self._seconds()
                    )
            before = before.after(item, stages, self.members, self._seconds())
            # Each step shows another photo.
            shown = item.number % len(joined)
            photo = joined[shown].number
            self._teller.tell(
                joined[shown],
                number,
                phases[photo],
                item.parts[shown],
                stages[photo],
                together=True,
            )

    def _stage(self, member: Member, phase: Phase) -> Stage | None:
        """A photo's stage for a phase, with its lamps chosen and lit where the phase looks at the
        photo.
        """
        if phase.face_px is not None:
            member.view.choose_lamps(member.state)
        stage = member.view.solver_stage(phase, member.state)
        if stage is not None and phase.face_px is not None:
            member.state = member.with_initial_lights(stage)
        return stage

    def _least_believed(self, phase: Phase) -> Member | None:
        """Of the photos that take part, the one that is least believed about the shape, if any is
        not.
        """
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

    def _heard_alone(
        self, member: Member, number: int, phase: Phase, item: Iteration, stage: Stage
    ) -> None:
        """A step that a photo took without the others."""
        if not self._teller.quiet:
            member.record(phase, item, stage, self._seconds())
        self._teller.tell(member, number, phase, item, stage, together=False)

    def _seconds(self) -> float:
        return time.monotonic() - self._started

    def _check(self, checkpoint: JointCheckpoint) -> None:
        """Raise InputError unless ``checkpoint`` is of these photos."""
        if len(checkpoint.photos) != len(self.members):
            raise InputError(
                f"The checkpoint in '{self.folder}' is of {len(checkpoint.photos)} photos, and "
                f"{len(self.members)} "
                "were given; give the same photos in the same order, or start again without "
                "--resume."
            )
        for photo, member in zip(checkpoint.photos, self.members, strict=True):
            photo.check_fingerprint(member.problem.fingerprint, self.folder)

    def _restore(self, checkpoint: JointCheckpoint, first: int) -> None:
        """Let everybody be where the checkpoint's phase began; ``first``: the first phase with the
        photos.
        """
        self.shape_held = checkpoint.shape_held
        for index, (photo, member) in enumerate(zip(checkpoint.photos, self.members, strict=True)):
            photo.restore(member.view)
            member.state, member.trace = photo.began, list(photo.trace)
            member.joined, member.doubt = checkpoint.joined[index], checkpoint.doubts[index]
            member.statistic = checkpoint.statistics[index]
            # The landmarks' last step is known; one who left with them took no other.
            member.missing = photo.phase > first and not member.stranger
