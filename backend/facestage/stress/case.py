"""What a case is: a job that should break the engine, and what would count as a lie about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from facestage.contract.job import Job

Build = Callable[[Path], Job]

# What is right: a fit (converged, or stopped with advice) | anything but a claim to have converged
# | a refusal.
FIT, DOUBT, REFUSAL = "fit", "doubt", "refusal"
DEFAULT_SECONDS = 300.0
# A fit must never end further from the truth than its own landmark stage; this is the noise of
# saying so.
SLACK_MM = 0.15


@dataclass(frozen=True)
class Case:
    """One stiff or extreme situation.

    A fit that says "converged" must keep both bounds; one that stops with advice may miss them.
    """

    name: str
    about: str
    build: Build  # writes photo, landmarks, model and truth into a folder
    worst_mm: float | None = None  # mean vertex distance after similarity alignment
    worst_psnr: float | None = None  # dB on the photo's face pixels
    right: str = FIT
    seconds: float = DEFAULT_SECONDS  # after this the case counts as hung


class Suite:
    """Cases by name, in the order in which they were added."""

    def __init__(self) -> None:
        self.cases: dict[str, Case] = {}

    def add(
        self,
        name: str,
        about: str,
        worst_mm: float | None = None,
        worst_psnr: float | None = None,
        right: str = FIT,
        seconds: float = DEFAULT_SECONDS,
    ) -> Callable[[Build], Build]:
        """Decorator: the function that builds the job of case ``name``."""

        def register(build: Build) -> Build:
            if name in self.cases:
                raise ValueError(f"two stress cases are named '{name}'")
            self.cases[name] = Case(name, about, build, worst_mm, worst_psnr, right, seconds)
            return build

        return register
