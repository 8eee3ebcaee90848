"""Where a film is cut."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

# Frames on each side of a piece that are followed for those within alone: half a second of most
# films, longer than a blink.
OVERLAP = 12


@dataclass(frozen=True)
class Piece:
    """Frames by index, each range without its end: the piece answers for those from ``first`` to
    ``end``, and looks at those from ``start`` to ``stop`` around them.
    """

    first: int
    end: int
    start: int
    stop: int

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"{self.first:06d}-{self.end:06d}"

    @property
    def looked_at(self) -> slice:
        """The frames of the film that it looks at."""
        return slice(self.start, self.stop)

    @property
    def own(self) -> slice:
        """Those that it answers for."""
        return slice(self.first, self.end)

    @property
    def inside(self) -> slice:
        """The same, counted from the first that it looks at."""
        return slice(self.first - self.start, self.end - self.start)


def cut(count: int, most: int, overlap: int = OVERLAP) -> list[Piece]:
    """So many frames in pieces as long as each other that answer for ``most`` at most."""
    number = -(-count // most)
    ends = [count * index // number for index in range(number + 1)]
    return [
        Piece(first, end, max(first - overlap, 0), min(end + overlap, count))
        for first, end in pairwise(ends)
    ]
