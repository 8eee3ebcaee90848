"""The phases of a fit: what moves in each, at which size of the face, with how many light
samples.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from facestage.contract.job import Job
from facestage.contract.quality import BEST, DRAFT
from facestage.fit.energy.shadow_edges import lamps_known
from facestage.fit.face.unknowns import GLOSS, LAMPS, SHAPE, SKIN
from facestage.fit.given.problem import COARSE_FACE_PX, FINE_FACE_PX


@dataclass(frozen=True)
class Phase:
    """A step of the schedule: what moves, at which size of the face, with how many light
    samples.
    """

    name: str
    blocks: tuple[str, ...]
    face_px: float | None  # None: landmarks only
    steps: int
    samples: int = 2
    share: float = 0.1  # of the whole work, for the progress bar
    shadow_edges: bool = False  # whether the derivatives know how cast shadows move


PHASES = (
    Phase("pose", ("pose", "focal"), None, 20, share=0.01),
    Phase("landmarks", SHAPE, None, 30, share=0.04),
    Phase("light and albedo", SKIN, COARSE_FACE_PX, 4, share=0.10),
    Phase("geometry", SHAPE + SKIN + LAMPS, COARSE_FACE_PX, 8, share=0.25),
    Phase("specular", SKIN + GLOSS, COARSE_FACE_PX, 3, share=0.10),
    Phase("joint", SHAPE + SKIN + LAMPS + GLOSS, FINE_FACE_PX, 8, samples=4, share=0.40),
)

# What the best quality does in the last phase: a face of more pixels, less noise in the light, more
# steps.
BEST_JOINT: dict[str, Any] = {"face_px": 1.35 * FINE_FACE_PX, "steps": 20, "samples": 8}


@dataclass(frozen=True)
class Schedule:
    """The phases of a run: what trades time for accuracy."""

    phases: tuple[Phase, ...] = PHASES

    def scaled(self, resolution: float = 1.0, samples: float = 1.0) -> Schedule:
        """Every photo phase at ``resolution`` times the pixels along a side and ``samples`` times
        the light samples.
        """
        return Schedule(
            tuple(
                phase
                if phase.face_px is None
                else replace(
                    phase,
                    face_px=phase.face_px * resolution,
                    samples=max(round(phase.samples * samples), 1),
                )
                for phase in self.phases
            )
        )

    @classmethod
    def of(cls, quality: str) -> Schedule:
        """The schedule of a job's quality."""
        if quality == DRAFT:
            return cls().until("joint")
        if quality == BEST:
            finer = replace(PHASES[-1], **BEST_JOINT)
            return cls((*PHASES[:-1], finer))
        return cls()

    def with_shadow_edges(self, on: bool) -> Schedule:
        """Every photo phase that moves the shape with, or without, the motion of cast shadows in
        its derivatives.
        """
        return Schedule(
            tuple(
                phase
                if phase.face_px is None
                else replace(phase, shadow_edges=on and not set(phase.blocks).isdisjoint(SHAPE))
                for phase in self.phases
            )
        )

    def limited(self, steps: int | None) -> Schedule:
        """With at most so many steps in each phase with a photo; None: as many as there are."""
        if steps is None:
            return self
        return Schedule(
            tuple(
                phase if phase.face_px is None else replace(phase, steps=min(phase.steps, steps))
                for phase in self.phases
            )
        )

    def until(self, name: str) -> Schedule:
        """The phases before the one called ``name``."""
        names = [phase.name for phase in self.phases]
        return Schedule(self.phases[: names.index(name)])


def default_schedule(job: Job, steps_max: int | None = None) -> Schedule:
    """The schedule of a job's quality: cast shadows move in its derivatives where the lamps' places
    are known.

    ``steps_max``: see :class:`Fineness`.
    """
    return Schedule.of(job.quality).with_shadow_edges(lamps_known(job)).limited(steps_max)
