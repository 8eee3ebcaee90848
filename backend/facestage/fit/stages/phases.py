"""The phases of a fit: what moves in each, at which size of the face, with how many light samples.

PHASES is the table of them all, and PhaseName what they are called. Who runs them asks a phase
what it is, never where in a schedule it stands.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

from facestage.contract.job import Job
from facestage.contract.quality import BEST, DRAFT
from facestage.fit.energy.shadow_edges import lamps_known
from facestage.fit.face.unknowns import BELOW, GLOSS, LAMPS, SHAPE, SKIN
from facestage.fit.given.problem import COARSE_FACE_PX, FINE_FACE_PX


class PhaseName(StrEnum):
    """What trace, progress and charts call the phases."""

    POSE = "pose"
    LANDMARKS = "landmarks"
    LIGHT = "light and albedo"
    GEOMETRY = "geometry"
    SPECULAR = "specular"
    JOINT = "joint"
    LENS = "lens"


# What the name of a phase ends with where it is run in another way than the schedule says.
TOGETHER, SHAPE_HELD, SHAPE_SHARED = " together", ", shape held", ", shape shared"


@dataclass(frozen=True)
class Phase:
    """What moves, at which size of the face, with how many light samples."""

    name: str
    blocks: tuple[str, ...]
    face_px: float | None  # None: landmarks only
    steps: int
    samples: int = 2
    share: float = 0.0  # of the time that all phases take, for the progress
    seed: int = 0  # added to the job's: no two phases draw the same light samples
    shadow_edges: bool = False  # whether the derivatives know how cast shadows move
    further: int = 0  # steps that may follow these, as long as it has not settled
    variant: str = ""  # how this phase differs from the schedule's of the same name

    @property
    def title(self) -> str:
        """What trace and progress call it."""
        return f"{self.name}{self.variant}"

    @property
    def with_photo(self) -> bool:
        """Whether it looks at the photo; else landmarks are all it knows."""
        return self.face_px is not None

    def varied(self, variant: str, held: Collection[str] = ()) -> Phase:
        """The same phase in another way: without the blocks that are ``held``."""
        blocks = tuple(name for name in self.blocks if name not in held)
        return replace(self, variant=variant, blocks=blocks)


PHASES = (
    Phase(PhaseName.POSE, ("pose", "focal"), None, 20, share=0.01, seed=0),
    Phase(PhaseName.LANDMARKS, SHAPE, None, 30, share=0.04, seed=1),
    Phase(PhaseName.LIGHT, SKIN, COARSE_FACE_PX, 4, share=0.11, seed=2),
    Phase(PhaseName.GEOMETRY, SHAPE + SKIN + LAMPS, COARSE_FACE_PX, 8, share=0.28, seed=3),
    Phase(PhaseName.SPECULAR, SKIN + GLOSS, COARSE_FACE_PX, 3, share=0.11, seed=4),
    Phase(
        PhaseName.JOINT,
        SHAPE + SKIN + LAMPS + GLOSS + BELOW,
        FINE_FACE_PX,
        8,
        samples=4,
        share=0.45,
        seed=5,
        further=8,
    ),
)
# Not of a schedule: the landmarks' shape through another lens, see lens_check.py.
LENS = Phase(PhaseName.LENS, SHAPE, None, 6)

# What the best quality does in the last phase: a face of more pixels, less noise in the light, more
# steps.
BEST_JOINT: dict[str, Any] = {"face_px": 1.35 * FINE_FACE_PX, "steps": 20, "samples": 8}


@dataclass(frozen=True)
class Schedule:
    """The phases of a run: what trades time for accuracy."""

    phases: tuple[Phase, ...] = PHASES

    @classmethod
    def of(cls, quality: str) -> Schedule:
        """The schedule of a job's quality."""
        if quality == DRAFT:
            return cls().until(PhaseName.JOINT)
        if quality == BEST:
            return cls().changed(lambda phase: BEST_JOINT if phase.name == PhaseName.JOINT else {})
        return cls()

    def __getitem__(self, name: str) -> Phase:
        """The phase called ``name``. Raises KeyError."""
        return {phase.name: phase for phase in self.phases}[name]

    @property
    def last(self) -> Phase:
        """Where a run ends."""
        return self.phases[-1]

    @property
    def landmark_phases(self) -> tuple[Phase, ...]:
        """The phases without the photo."""
        return tuple(phase for phase in self.phases if not phase.with_photo)

    @property
    def photo_phases(self) -> tuple[Phase, ...]:
        """The phases with the photo."""
        return tuple(phase for phase in self.phases if phase.with_photo)

    def until(self, name: str) -> Schedule:
        """The phases before the one called ``name``."""
        return Schedule(self.phases[: self.phases.index(self[name])])

    def since(self, name: str) -> Schedule:
        """The phase called ``name`` and those after it."""
        return Schedule(self.phases[self.phases.index(self[name]) :])

    def changed(self, change: Callable[[Phase], dict[str, Any]]) -> Schedule:
        """With other properties, by name, of the phases with the photo."""
        return Schedule(
            tuple(
                replace(phase, **change(phase)) if phase.with_photo else phase
                for phase in self.phases
            )
        )

    def scaled(self, resolution: float = 1.0, samples: float = 1.0) -> Schedule:
        """Every phase with the photo at ``resolution`` times the pixels along a side and
        ``samples`` times the light samples.
        """

        def scale(phase: Phase) -> dict[str, Any]:
            assert phase.face_px is not None
            more = max(round(phase.samples * samples), 1)
            return {"face_px": phase.face_px * resolution, "samples": more}

        return self.changed(scale)

    def with_shadow_edges(self, on: bool) -> Schedule:
        """Every phase that moves the shape by the photo with, or without, the motion of cast
        shadows in its derivatives.
        """
        return self.changed(
            lambda phase: {"shadow_edges": on and not set(phase.blocks).isdisjoint(SHAPE)}
        )

    def limited(self, steps: int | None) -> Schedule:
        """With at most so many steps in each phase with the photo; None: as many as there are."""
        if steps is None:
            return self
        return self.changed(lambda phase: {"steps": min(phase.steps, steps), "further": 0})


def default_schedule(job: Job, steps_max: int | None = None) -> Schedule:
    """The schedule of a job's quality: cast shadows move in its derivatives where the lamps' places
    are known.

    ``steps_max``: see :class:`Fineness`.
    """
    return Schedule.of(job.quality).with_shadow_edges(lamps_known(job)).limited(steps_max)
