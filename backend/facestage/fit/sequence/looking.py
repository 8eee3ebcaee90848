"""A question about one frame, and who answers it: here, or in another process."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import UInt8
from facestage.fit.face.state import State
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.frames import Cut, FrameView, Seen


@dataclass(frozen=True, eq=False)
class Question:
    """What does the frame ``index`` say around ``state``?"""

    index: int
    cut: Cut | None  # None: no face
    state: State | None = None
    skin: UInt8[np.ndarray, "height width"] | None = None  # where it was found before
    quarter: int | None = None  # see PhotoTerm.quarter


@dataclass(frozen=True, eq=False)
class Answer:
    """What it says, and which of its pixels show skin."""

    index: int
    seen: Seen | None = None
    skin: UInt8[np.ndarray, "height width"] | None = None


@dataclass(frozen=True, eq=False)
class Looker:
    """Answers questions about frames of one person."""

    actor: Actor
    light_held: bool

    def answers(self, questions: Iterable[Question]) -> Iterator[Answer]:
        """One after another."""
        return map(self.answer, questions)

    def answer(self, question: Question) -> Answer:
        """Looks at a frame."""
        if question.cut is None or question.state is None:
            return Answer(question.index)
        view = FrameView.of(
            self.actor, question.cut, question.skin, self.light_held, question.quarter
        )
        seen = view.seen(question.state)
        return Answer(question.index, seen, view.skin if question.skin is None else None)
