"""One photo of a person: where its fit stands, and what it does without the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.errors import InputError
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import RELIEF, SHAPE, SHARED, with_unknowns
from facestage.fit.given.problem import Problem
from facestage.fit.given.truth import Truth
from facestage.fit.runs.trace import trace_row
from facestage.fit.stages.passage import Passage, walk
from facestage.fit.stages.phases import SHAPE_HELD, SHAPE_SHARED, TOGETHER, Phase, Schedule
from facestage.fit.stages.photo_descent import Iteration, PhotoDescent
from facestage.fit.stages.view import View
from facestage.fit.trust.checks import Ending, conclude, photo_doubt
from facestage.fit.trust.fitted import Fitted
from facestage.fit.trust.guard import statistic_limit
from facestage.fit.trust.same_person import Evidence


class MissingStepError(Exception):
    """Something is asked of a photo's last step, which was taken before the checkpoint that the run
    went on from.
    """


# Told of each accepted step: the photo, its way through the phase, and the step.
Tell = Callable[["Member", Passage, Iteration], None]


@dataclass
class Member:
    """States are at the photo's full size."""

    number: int  # 1, 2, ...
    view: View
    schedule: Schedule
    truth: Truth | None
    state: State
    start: State  # where its own landmark phases ended
    together: State  # where the landmark phases of all photos ended
    trace: list[dict[str, Any]] = field(default_factory=list)
    last: Iteration | None = None
    # ``last`` was before the checkpoint that the run goes on from, and is not known
    missing: bool = False
    joined: bool = True  # takes part in the joint fit
    stranger: bool = False  # left out because its landmarks may be another person's
    doubt: str = ""  # why the photo is not believed about the shape
    # how far the joint fit pulled the shape from the photo's own landmarks', see guard.py
    statistic: float = 0.0
    # the albedo's coefficients that those who take part begin with; None: by its own exposure
    skin: Float[np.ndarray, " albedos"] | None = None

    @property
    def problem(self) -> Problem:
        """The photo's problem."""
        return self.view.problem

    def phase(self, name: str, shape_held: bool, matched: bool = False) -> Phase:
        """The phase called ``name`` of all photos together, with or without the shape; ``matched``:
        where they are compared with each other.
        """
        phase = self.schedule[name]
        if not phase.with_photo:
            # The photo's own phases of landmarks have the plain names. Fine shading would be
            # explained by a wrong relief: it moves before the photos' light is looked at.
            moving = phase.blocks + (RELIEF if matched else ())
            return replace(phase.varied(TOGETHER), blocks=moving)
        return phase.varied(SHAPE_HELD, SHAPE) if shape_held else phase

    def passage(self, name: str, shape_held: bool, matched: bool = False) -> Passage | None:
        """Where the phase called ``name`` of all photos together begins, see :meth:`phase`; None
        where the photo has nothing to move.
        """
        with self._named():
            phase = self.phase(name, shape_held, matched)
            return Passage.prepared(self.view, phase, self.state, skin=self.skin)

    def landmarks_alone(self, tell: Tell) -> Evidence | None:
        """Its own landmark phases; what they say of the identity, where it is fitted and has a
        prior.
        """
        last: tuple[Iteration, PhotoDescent] | None = None

        def told(passage: Passage, item: Iteration) -> None:
            nonlocal last
            self.state, last = passage.state, (item, passage.descent)
            tell(self, passage, item)

        walk(self.view, self.schedule.landmark_phases, self.state, told=told)
        self.start = self.state
        where = Layout(self.state).slices["identity"]
        if last is None or not last[1].active[where].all() or not self.problem.job.weights.prior:
            return None
        return Evidence.of(*last) if where.start < where.stop else None

    def seen_by(self, view: View) -> None:
        """Go on with a ``view`` of the same photo that may have more lights, all dark."""
        if view is not self.view and view.problem.added:
            self.last = None  # was of fewer lights
        self.view = view
        self.state, self.start, self.together = (
            view.unlit(state) for state in (self.state, self.start, self.together)
        )

    def disbelief(self) -> tuple[float, str]:
        """How little the photo is believed about the shape where it stands, above 0 if not at all,
        and why.
        """
        self._need_last_step()
        psnr = self.trace[-1].get("psnr") if self.trace else None
        clause, self.statistic = photo_doubt(self.view, self.start, self.state, self.last, psnr)
        if not clause:
            return 0.0, ""
        limit = statistic_limit(self.view.free_shape(Layout(self.state)))
        # What no face explains is worse than any distance.
        return (self.statistic / limit if self.statistic > limit else np.inf), clause

    def follow(self, shared: State, deadline: float, tell: Tell) -> None:
        """Take the others' shape and skin; pose and expression by landmarks, and light by the
        photo, are its own.
        """
        state = with_unknowns(self.together, shared, SHARED)
        state = replace(state, lights=np.zeros_like(state.lights))
        alone = [
            phase.varied(SHAPE_SHARED, SHARED + SHAPE if phase.with_photo else SHARED)
            for phase in self.schedule.phases
        ]

        def told(passage: Passage, item: Iteration) -> None:
            self.took(passage, item)
            tell(self, passage, item)

        with self._named():
            self.state = walk(self.view, alone, state, deadline, told)

    def took(self, passage: Passage, item: Iteration) -> None:
        """A step that led to where ``passage`` is."""
        self.state, self.last, self.missing = passage.state, item, False

    def record(self, passage: Passage, item: Iteration, seconds: float) -> None:
        """Add a row to the trace."""
        self.trace.append(trace_row(passage, item, seconds, self.truth))

    def concluded(self, shape_held: bool, seconds: float, in_time: bool) -> Fitted:
        """The fit as it ended, see :func:`conclude`."""
        self._need_last_step()
        phase = self.phase(self.schedule.last.name, shape_held)
        ending = Ending(
            phase, self.start, self.state, self.last, self.trace, self.doubt, self.statistic
        )
        return conclude(self.view, ending, seconds, in_time)

    def _need_last_step(self) -> None:
        if self.missing:
            raise MissingStepError

    @contextmanager
    def _named(self) -> Iterator[None]:
        """An error says which photo it is about."""
        try:
            yield
        except InputError as error:
            raise InputError(
                f"Photo {self.number} ('{self.problem.job.image.name}'): {error}"
            ) from error
