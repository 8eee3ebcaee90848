"""The way through a phase, of one photo or of several together: all who take steps take them here.

A passage knows where its photos are at their full size, while the solver sees them at the size of
the phase.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.energy.plan import Ledger
from facestage.fit.face.state import State
from facestage.fit.solve.bounded_step import Damping
from facestage.fit.solve.descent import Descent
from facestage.fit.stages.joint_descent import JointDescent, JointIteration
from facestage.fit.stages.phases import Phase
from facestage.fit.stages.photo_descent import Iteration, PhotoDescent
from facestage.fit.stages.view import View
from facestage.fit.stereo.joint_term import JointTerm


class _Told(Protocol):
    @property
    def parts(self) -> tuple[Iteration, ...]:
        """The step of each photo."""


S = TypeVar("S")
T = TypeVar("T", bound=_Told)


@dataclass(frozen=True)
class Within:
    """Where a phase was after so many steps."""

    step: int
    state: State  # at the size of the phase
    damping: tuple[float, float]
    resting: np.ndarray  # (N,) bool, lights that rest; none when empty


class Passage:
    """One photo on its way through a phase."""

    def __init__(self, view: View, phase: Phase, descent: PhotoDescent, state: State) -> None:
        """``state`` is at the photo's full size."""
        self.view, self.phase, self.descent = view, phase, descent
        self.state = state  # where the photo is, at its full size
        self.scaled = view.scaled(phase, state)  # where the first step begins
        self.first = 1  # the first step's number

    @classmethod
    def prepared(
        cls,
        view: View,
        phase: Phase,
        state: State,
        keep_light: bool = False,
        skin: Float[np.ndarray, " albedos"] | None = None,
    ) -> Passage | None:
        """Where ``phase`` begins from ``state``; None where all that it could move is held.

        Before the photo is looked at, the lamps that may move are chosen, and lights are lit where
        all are dark; ``keep_light``: both stay as the phase before had them. ``skin``: the albedo's
        coefficients where lights are first lit, see :meth:`View.with_initial_lights`.
        """
        if phase.with_photo and not keep_light:
            view.choose_lamps(state)
            view.look_again(phase, state)
            state = view.with_initial_lights(phase, view.without_next_to_nothing(state), skin)
            state = view.without_unseen_bounces(phase, state)
            state = view.with_scattering(phase, state)
        descent = view.descent(phase, state)
        return None if descent is None else cls(view, phase, descent, state)

    @property
    def photo(self) -> np.ndarray | None:
        """(h, w, 3) linear, what the solver sees of the photo; None in a phase without it."""
        term = self.descent.energy.photo
        return None if term is None else term.photo.color

    @property
    def seed(self) -> int:
        """Of the phase's light samples."""
        return self.view.problem.job.seed + self.phase.seed

    def enter(self, within: Within, ledger: Ledger) -> None:
        """Begin where the phase was ``within``; ``ledger``: what had been counted there."""
        self.descent.resume(Damping(*within.damping), within.resting, deepcopy(ledger))
        self.scaled, self.first = within.state, within.step + 1
        self.move(within.state)

    def move(self, scaled: State) -> None:
        """Be at ``scaled``, a state at the size of the phase."""
        self.state = self.view.full_size(self.phase, scaled, self.state)

    def steps(self, deadline: float) -> Iterator[Iteration]:
        """The accepted steps until ``deadline`` (time.monotonic); the photo is where each led."""
        return _steps((self,), self.descent, self.scaled, deadline)

    def within(self, item: Iteration) -> Within:
        """Where the phase is after ``item``, its last step."""
        damping = (item.damping.value, item.damping.growth)
        return Within(item.number, item.state, damping, self.descent.resting)


class JointPassage:
    """Several photos of one person on their way through a phase together."""

    def __init__(self, photos: Sequence[Passage], terms: Sequence[JointTerm] = ()) -> None:
        """All where one phase begins, with ``terms`` between them; from now on, each may be
        entered.
        """
        self.photos = tuple(photos)
        self.descent = JointDescent([photo.descent for photo in photos], terms)
        for photo, descent in zip(photos, self.descent.descents, strict=True):
            photo.descent = descent

    def steps(self, deadline: float) -> Iterator[JointIteration]:
        """As of one photo; every photo is where the step led."""
        # They were entered after the same step, or all begin.
        self.descent.damping = self.photos[0].descent.damping
        scaled = tuple(photo.scaled for photo in self.photos)
        return _steps(self.photos, self.descent, scaled, deadline)


def _steps(
    photos: Sequence[Passage], descent: Descent[S, Any, Any, T], start: S, deadline: float
) -> Iterator[T]:
    for item in descent.run(start, photos[0].seed, deadline, photos[0].first):
        for photo, part in zip(photos, item.parts, strict=True):
            photo.move(part.state)
        yield item


def nobody(passage: Passage, item: Iteration) -> None:
    """Hear of a step, and do nothing."""


def walk(
    view: View,
    phases: Iterable[Phase],
    state: State,
    deadline: float = float("inf"),
    told: Callable[[Passage, Iteration], None] = nobody,
    *,
    keep_light: bool = False,
) -> State:
    """One photo through ``phases``, as far as ``deadline`` (time.monotonic) allows: where it ends.

    Phases without the photo are walked through whatever the time. ``told`` hears of each step;
    ``keep_light``: see :meth:`Passage.prepared`.
    """
    for phase in phases:
        if phase.with_photo and time.monotonic() > deadline:
            break
        passage = Passage.prepared(view, phase, state, keep_light)
        if passage is None:
            continue
        for item in passage.steps(deadline):
            told(passage, item)
        state = passage.state
    return state
