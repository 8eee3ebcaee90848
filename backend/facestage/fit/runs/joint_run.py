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
from facestage.fit.face.unknowns import RELIEF, SHAPE, SHARED, with_unknowns
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.runs.joint_checkpoint import JointCheckpoint
from facestage.fit.runs.member import Member, MissingStepError
from facestage.fit.runs.progress import Progress, Scale
from facestage.fit.stages.joint_descent import JointDescent, JointIteration
from facestage.fit.stages.matching import CLOSEST, LOOKS, Look, compared_photos, stereo_between
from facestage.fit.stages.passage import JointPassage, Passage
from facestage.fit.stages.phases import Phase, Schedule, default_schedule
from facestage.fit.stages.photo_descent import Iteration
from facestage.fit.stages.teeth_height import with_teeth_seen
from facestage.fit.stages.view import View
from facestage.fit.trust.fitted import Fitted
from facestage.fit.trust.same_person import Difference, Likeness, combined, odd_ones


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
        listen: Callable[[Progress], None] = lambda progress: None,
        schedule: Schedule | None = None,
    ) -> None:
        """One problem, renderer and truth per photo; the problems share one face geometry."""
        self._given = tuple(zip(problems, forwards, truths, strict=True))
        self._schedule = schedule
        self.members = self._new_members()
        self.schedule = self.members[0].schedule
        self.folder = folder
        # No photo was believed: the shape is the landmarks'.
        self.shape_held = False
        # The last step, for what all photos together say of each one's parameters.
        self._final: tuple[JointDescent, JointIteration, list[Member]] | None = None
        self._started, self._deadline = 0.0, np.inf
        self._scale, self.listen = Scale(self.schedule, len(self.members)), listen
        # While what a checkpoint has seen already is done again.
        self._quiet = False

    def run(self, deadline: float, checkpoint: JointCheckpoint | None = None) -> JointFitted:
        """All phases from the start, or from ``checkpoint``, until done or ``deadline``
        (time.monotonic).
        """
        if checkpoint is not None:
            self._check(checkpoint)
            checkpoint = checkpoint.with_relief(len(self.members[0].state.relief))
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
            schedule = self._schedule or default_schedule(problem.job, problem.fineness.steps_max)
            members.append(Member(number, view, schedule, truth, state, state, state))
        return members

    def _run(self, deadline: float, checkpoint: JointCheckpoint | None) -> JointFitted:
        self._started, self._deadline = time.monotonic(), deadline
        if checkpoint is not None:
            self._started -= checkpoint.photos[0].seconds
        self._quiet = checkpoint is not None
        odd = self._landmarks()
        self._quiet = False
        phases = list(self.schedule.photo_phases)
        if checkpoint is not None:
            self._restore(checkpoint)
            # The step that a checkpoint was before is taken whatever the time.
            began, *phases = self.schedule.since(checkpoint.phase).phases
            self._photo_phase(began, checkpoint)
        for phase in phases:
            if time.monotonic() > deadline:
                break
            if phase.name == self.schedule.photo_phases[0].name:
                self._look_behind(phase)
            self._photo_phase(phase, None)
        shared = next(member.state for member in self.members if member.joined)
        for member in self.members:
            if not member.joined:
                member.follow(shared, deadline, self._heard_alone)
        self._look_at_teeth()
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
            if odd:
                # Landmarks take one person for two more often than skin does.
                odd = odd_ones(known, self._skins())
            if len(odd) <= len(known) - 2:
                for index in odd:
                    self.members[index].joined, self.members[index].stranger = False, True
            joined = [one for one, member in zip(known, self.members, strict=True) if member.joined]
            shared = replace(shared, identity=combined(joined)[0])
        for member in self.members:
            member.state = with_unknowns(member.state, shared, SHARED)
        for phase in self.schedule.landmark_phases:
            if not set(SHARED).isdisjoint(phase.blocks):
                self._descend(phase, None)
                # Better shapes find better matches; a checkpoint has had the time for all looks.
                for look in LOOKS:
                    if self._quiet or time.monotonic() <= self._deadline:
                        self._descend(phase, None, look)
        for member in self.members:
            member.together = member.state
        return odd

    def _look_behind(self, phase: Phase) -> None:
        """Find what each photo needs of light before its first ``phase``."""
        for member in self.members:
            self._see(member, member.view.lit(phase, member.state))

    def _begin_with_one_skin(self, phase: Phase) -> None:
        """Let all begin ``phase`` as light as in the mean of those whose exposures say it."""
        joined = [member for member in self.members if member.joined]
        begun = [member.view.with_initial_lights(phase, member.state).albedo for member in joined]
        said = [
            albedo
            for albedo, member in zip(begun, joined, strict=True)
            if (albedo != member.state.albedo).any()
        ]
        for member in joined:
            member.skin = np.mean(said, axis=0) if said else None

    def _see(self, member: Member, view: View) -> None:
        """Let a photo go on with ``view``, which may have more lights."""
        if view is not member.view and view.problem.added:
            self._final = None  # was of fewer lights
        member.seen_by(view)

    def _skins(self) -> dict[tuple[int, int], Likeness]:
        """How alike the photos' skins are, each with the face where its own landmarks put it."""
        compared = compared_photos(
            [member.view for member in self.members],
            [member.start for member in self.members],
            LOOKS[0],
        )
        return {pair: Likeness(one.textured, one.likeness) for pair, one in compared.items()}

    def _photo_phase(self, phase: Phase, checkpoint: JointCheckpoint | None) -> None:
        """A phase with the photos; again, without the least believed photo, when one is not
        believed after it.
        """
        while True:
            if phase.name == self.schedule.photo_phases[0].name:
                self._begin_with_one_skin(phase)
            final = self._final
            before = [
                (member, member.state, member.last, member.missing)
                for member in self.members
                if member.joined
            ]
            self._descend(phase, checkpoint, CLOSEST)
            leaving = self._least_believed(phase)
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

    def _descend(
        self, phase: Phase, checkpoint: JointCheckpoint | None, look: Look | None = None
    ) -> None:
        """All photos that take part, through ``phase`` together; from ``checkpoint`` if it was left
        there. ``look``: how closely they are compared with each other, if they are.
        """
        seconds = self._seconds()
        before = checkpoint or JointCheckpoint.of(
            self.members, phase.name, seconds, self.shape_held
        )
        company = self._company(phase, matched=look is not None)
        passages = [passage for _, passage in company]
        term = None if look is None or len(company) < 2 else stereo_between(passages, look)
        if term is None and any(set(RELIEF) & set(passage.phase.blocks) for passage in passages):
            # Nothing but a match says anything of the relief.
            company = self._company(phase)
            passages = [passage for _, passage in company]
        if not company:
            return
        joint = JointPassage(passages, () if term is None else (term,))
        for member, passage in company:
            own = before.photos[member.number - 1]
            if own.within is not None:
                passage.enter(own.within, own.ledger)
            member.state = passage.state
        for item in joint.steps(self._deadline):
            # Where an accepted step began is saved once it is accepted; landmarks are done again.
            if phase.with_photo:
                before.save(self.folder)
            self._final = (joint.descent, item, [member for member, _ in company])
            for (member, passage), part in zip(company, item.parts, strict=True):
                member.took(passage, part)
                if not self._quiet:
                    member.record(passage, part, self._seconds())
            before = before.after(item, company, self._seconds())
            # Each step shows another photo.
            shown = item.number % len(company)
            self._tell(*company[shown], item.parts[shown], together=True)

    def _company(self, phase: Phase, matched: bool = False) -> list[tuple[Member, Passage]]:
        """Who takes part in ``phase``, and where each begins."""
        passages = [
            (member, member.passage(phase.name, self.shape_held, matched))
            for member in self.members
            if member.joined
        ]
        return [(member, passage) for member, passage in passages if passage is not None]

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

    def _look_at_teeth(self) -> None:
        """What all photos together show of them, of one person's."""
        members = [member for member in self.members if not member.stranger]
        states = with_teeth_seen([(member.view, member.state) for member in members])
        for member, state in zip(members, states, strict=True):
            member.state = state

    def _marginalize_the_last_step(self) -> None:
        """Each photo's last step with what all photos together say of its parameters."""
        if self._final is None:
            return
        joint, item, joined = self._final
        free = joint.layout.all_true([~member.view.held(member.state) for member in joined])
        for index, member in enumerate(joined):
            if member.joined:
                member.last = item.marginal(index, joint.layout, free)

    def _heard_alone(self, member: Member, passage: Passage, item: Iteration) -> None:
        """A step that a photo took without the others."""
        if not self._quiet:
            member.record(passage, item, self._seconds())
        self._tell(member, passage, item, together=False)

    def _tell(self, member: Member, passage: Passage, item: Iteration, together: bool) -> None:
        """A step that is the last row of the member's trace."""
        if self._quiet:
            return
        number, scale = member.number, self._scale
        fraction = scale.after(passage, item) if together else scale.alone(number)
        self.listen(Progress.of(passage, item, member.trace[-1], fraction, number, together))

    def _seconds(self) -> float:
        return time.monotonic() - self._started

    def _check(self, checkpoint: JointCheckpoint) -> None:
        """Raise InputError unless ``checkpoint`` is of these photos."""
        if len(checkpoint.photos) != len(self.members):
            raise InputError(
                f"The checkpoint in '{self.folder}' is of {len(checkpoint.photos)} photos, and "
                f"{len(self.members)} were given; give the same photos in the same order, or start "
                "again without --resume."
            )
        for photo, member in zip(checkpoint.photos, self.members, strict=True):
            photo.check(member.problem.fingerprint, member.schedule, self.folder)

    def _restore(self, checkpoint: JointCheckpoint) -> None:
        """Let everybody be where the checkpoint's phase began."""
        first = self.schedule.photo_phases[0].name
        self.shape_held = checkpoint.shape_held
        for index, (photo, member) in enumerate(zip(checkpoint.photos, self.members, strict=True)):
            self._see(member, photo.restored(member.view))
            member.state, member.trace = photo.began, list(photo.trace)
            member.joined, member.doubt = checkpoint.joined[index], checkpoint.doubts[index]
            member.statistic = checkpoint.statistics[index]
            # The landmarks' last step is known; one who left with them took no other.
            member.missing = photo.phase != first and not member.stranger
