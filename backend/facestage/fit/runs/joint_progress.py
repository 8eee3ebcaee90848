"""What a fit of several photos says while it runs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from facestage.fit.runs.member import Member
from facestage.fit.stages.phases import Phase
from facestage.fit.stages.stage import Iteration, Stage
from facestage.fit.trust.fitted import Progress


@dataclass(frozen=True)
class JointProgress:
    """What a listener hears: a step of one photo alone, or of all photos together, told by one of
    them.
    """

    photo: int  # 1, 2, ...
    together: bool
    progress: Progress


@dataclass
class Teller:
    """Turns the steps of ``photos`` photos into progress."""

    listen: Callable[[JointProgress], None]
    phases: tuple[Phase, ...]
    photos: int
    fraction: float = 0.0
    quiet: bool = False  # while what a checkpoint has seen already is done again

    def tell(
        self,
        member: Member,
        number: int,
        phase: Phase,
        item: Iteration,
        stage: Stage,
        together: bool,
    ) -> None:
        """A step that is the last row of the member's trace."""
        if self.quiet:
            return
        if together:
            done = sum(earlier.share for earlier in self.phases[:number])
            done += phase.share * (1.0 if item.finished else item.number / phase.steps)
        else:
            landmarks = sum(one.share for one in self.phases if one.face_px is None)
            done = landmarks * (member.number - 1) / self.photos
        # What is done again is no step back.
        self.fraction = max(self.fraction, done)
        photo = None if stage.energy.photo is None else stage.energy.photo.photo.color
        row = member.trace[-1]
        progress = Progress(
            phase.name,
            item.number,
            self.fraction,
            row["seconds"],
            row.get("photo_rms"),
            item.evaluation,
            photo,
            member.state,
        )
        self.listen(JointProgress(member.number, together, progress))
