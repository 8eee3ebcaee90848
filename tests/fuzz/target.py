"""One reader of the fuzzer's table."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fuzz.case import Case
from fuzz.choice import choices_of
from fuzz.damage.case import damaged


@dataclass(frozen=True)
class Target:
    """One reader. Of every sum(shares) inputs it gets ``share``: cheap readers get many."""

    name: str
    covers: tuple[str, ...]  # the modules whose reading it exercises
    seeds: Callable[[], list[Case]]
    read: Callable[[Path], None]
    share: int
    # Beside FacestageError: what the reader says that it raises.
    refusals: tuple[type[Exception], ...] = ()
    fixed: tuple[str, ...] = ()  # files that are not damaged
    plain: bool = False  # the reader is given bytes, so that there is no pipe or folder to find
    warm: bool = True  # its seeds may be read without limits, for what is imported and cached

    def case(self, seeds: list[Case], seed: int, number: int) -> Case | None:
        """Input ``number`` of the run ``seed``; None where its choices do not suffice."""
        return choices_of(
            f"{self.name}/{seed}/{number}",
            lambda choose: damaged(choose, seeds, self.fixed, self.plain),
        )
