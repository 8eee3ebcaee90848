"""The quality names of a budget, and what the bench measured of each."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from facestage.contract.errors import InputError

DRAFT, GOOD, BEST = "draft", "good", "best"
QUALITIES = (DRAFT, GOOD, BEST)
# Written by `facestage bench`, which says so; copied here by hand when the solver changes.
MEASURED = Path(__file__).with_name("quality.json")


@dataclass(frozen=True)
class Expectation:
    """Medians over the bench's photographs with known truth."""

    seconds: float  # of optimisation and albedo detail
    similarity_mm: float
    psnr: float  # dB, with the albedo detail

    def sentence(self) -> str:
        """For tooltips and help."""
        return f"about {self.seconds:.0f} s, {self.similarity_mm:.1f} mm, {self.psnr:.0f} dB"


@cache
def expectations(measured: Path = MEASURED) -> dict[str, Expectation]:
    """By quality name; empty where nothing was measured."""
    if not measured.is_file():
        return {}
    data = json.loads(measured.read_text(encoding="utf-8"))
    return {
        name: Expectation(**data["qualities"][name])
        for name in QUALITIES
        if name in data["qualities"]
    }


def describe(name: str) -> str:
    """One line about a quality: what it does and what to expect of it."""
    words = {
        DRAFT: "a coarse photo, no joint refinement",
        GOOD: "the whole schedule",
        BEST: "a finer photo, more light samples and steps",
    }
    found = expectations().get(name)
    return words[name] if found is None else f"{words[name]}: {found.sentence()}"


def parse_budget(text: str) -> tuple[float | None, str]:
    """Seconds (or None) and quality of ``text``: a number, or a quality's name.

    Raises InputError.
    """
    if text in QUALITIES:
        return None, text
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not (math.isfinite(seconds) and seconds > 0):
        raise InputError(
            f"The budget is '{text}'; expected seconds greater than 0, or {', '.join(QUALITIES)}."
        )
    return seconds, GOOD
