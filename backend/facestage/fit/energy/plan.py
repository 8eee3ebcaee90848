"""What a job does not need: the rules that leave it out, and the ledger of what was done and what
was not.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass, field, fields

from facestage.contract.job import LEAN


@dataclass(frozen=True)
class Rules:
    """Which omissions are made.

    None of them changes the answer beyond rounding; each can be turned off.
    """

    # pixels of weight zero are not lit, nor looked for outside the face's bounding box
    pixels: bool = True
    # lights that are off, or were fitted to zero and want to stay there, are not traced
    lights: bool = True
    # no column of the Jacobian for what is frozen, or moves nothing that is seen
    columns: bool = True
    # no derivative by the surface while it rests, no highlight while there is none
    terms: bool = True

    @classmethod
    def of(cls, plan: str) -> Rules:
        """The rules of a job's ``plan``: all of them, or none."""
        return cls(**{rule.name: plan == LEAN for rule in fields(cls)})


@dataclass
class Work:
    """Seconds of one kind of work, and the units that were done in them."""

    seconds: float = 0.0
    units: float = 0.0


@dataclass
class Ledger:
    """What a run worked on, by kind, and what each rule left out, in units of a kind of work.

    Kinds are views: the same seconds may be counted once by pixel and once by light sample.
    """

    work: dict[str, Work] = field(default_factory=dict)
    skipped: dict[tuple[str, str], float] = field(default_factory=dict)  # -> units

    @contextmanager
    def timed(self, **units: float) -> Iterator[dict[str, float]]:
        """Time a block of work; ``units`` by kind, to which the block may add what it learns."""
        found = dict(units)
        began = time.perf_counter()
        yield found
        seconds = time.perf_counter() - began
        for kind, count in found.items():
            work = self.work.setdefault(kind, Work())
            work.seconds += seconds
            work.units += count

    def skip(self, rule: str, **units: float) -> None:
        """Count units of work that ``rule`` left out."""
        for kind, count in units.items():
            if count > 0:
                self.skipped[rule, kind] = self.skipped.get((rule, kind), 0.0) + float(count)

    def set_to(self, other: Ledger) -> None:
        """Say what ``other`` says now."""
        self.work, self.skipped = deepcopy(other.work), dict(other.skipped)

    def rate(self, kind: str) -> float | None:
        """Units per second of a kind of work in this run; None when there was none."""
        work = self.work.get(kind)
        return (
            None
            if work is None or work.seconds <= 0 or work.units <= 0
            else work.units / work.seconds
        )

    def saved(self, rule: str) -> dict[str, tuple[float, float | None]]:
        """By kind: the units that ``rule`` left out, and the seconds they would have taken at this
        run's rate.
        """
        result = {}
        for (name, kind), units in self.skipped.items():
            if name == rule:
                rate = self.rate(kind)
                result[kind] = (units, None if rate is None else units / rate)
        return result


@dataclass(frozen=True)
class Plan:
    """The rules of a run and its ledger, into which everything that follows the rules counts."""

    rules: Rules = field(default_factory=Rules)
    ledger: Ledger = field(default_factory=Ledger)
