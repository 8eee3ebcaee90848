"""How far a run is: one scale from 0 to 1, from the first step to the last picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.face.state import State
from facestage.fit.stages.passage import Passage
from facestage.fit.stages.phases import Schedule
from facestage.fit.stages.photo_descent import Iteration

# Where on the scale the last phase ends, and the textures; the rest are pictures.
FITTED, PAINTED = 0.90, 0.93


@dataclass(frozen=True)
class Progress:
    """What a listener hears of each step."""

    phase: str
    iteration: int
    fraction: float  # of the whole run
    seconds: float
    photo_rms: float | None
    evaluation: Evaluation | None
    photo: np.ndarray | None  # (h, w, 3) at the phase's resolution
    state: State  # at the photo's full size
    number: int = 1  # which photo this is of: 1, 2, ...
    together: bool = True  # all photos took the step; else this one alone

    @classmethod
    def of(
        cls,
        passage: Passage,
        item: Iteration,
        row: Mapping[str, Any],
        fraction: float,
        number: int = 1,
        together: bool = True,
    ) -> Progress:
        """A step that led to where ``passage`` is; ``row``: what the trace says of it."""
        return cls(
            phase=passage.phase.title,
            iteration=item.number,
            fraction=fraction,
            seconds=row["seconds"],
            photo_rms=row.get("photo_rms"),
            evaluation=item.evaluation,
            photo=passage.photo,
            state=passage.state,
            number=number,
            together=together,
        )

    @property
    def seconds_left(self) -> float:
        """What the rest of the run takes, if it goes on like this."""
        return self.seconds * (1 - self.fraction) / max(self.fraction, 1e-3)


class Scale:
    """The fraction of a run that is done; what is done again is no step back."""

    def __init__(self, schedule: Schedule, photos: int = 1) -> None:
        self._schedule, self._photos = schedule, photos
        self._unit = FITTED / max(sum(phase.share for phase in schedule.phases), 1e-9)
        self._fraction = 0.0

    def after(self, passage: Passage, item: Iteration) -> float:
        """After a step of all photos, of a phase of the schedule."""
        phase = passage.phase
        before = sum(earlier.share for earlier in self._schedule.until(phase.name).phases)
        part = 1.0 if item.finished else min(item.number / phase.steps, 1.0)
        return self._at_least(before + part * phase.share)

    def alone(self, number: int) -> float:
        """After a step that photo ``number`` takes for itself: where only landmarks are known, or
        when the others are done.
        """
        landmarks = sum(phase.share for phase in self._schedule.landmark_phases)
        return self._at_least(landmarks * (number - 1) / self._photos)

    def _at_least(self, share: float) -> float:
        self._fraction = max(self._fraction, self._unit * share)
        return self._fraction


def painting(number: int, photos: int) -> float:
    """The fraction that is done before the textures of photo ``number`` of so many are made."""
    return FITTED + (PAINTED - FITTED) * (number - 1) / photos


def drawing(number: int, photos: int) -> float:
    """The fraction that is done before the pictures of photo ``number`` of so many are drawn."""
    return PAINTED + (1 - PAINTED) * (number - 1) / photos
