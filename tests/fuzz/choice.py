"""Where the choices of a mutator come from: Hypothesis, fed with the bytes that belong to one
input's number.

``fuzz_one_input`` is Hypothesis's door for outside engines: the same bytes give the same draws, so
an input is known by (target, seed, number) alone, on any machine.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, TypeVar

import hypothesis
from hypothesis import strategies

T = TypeVar("T")
BUFFER_BYTES = 4096  # choices of one input; what needs more of them is passed over

_JSON_LEAVES = (
    strategies.none()
    | strategies.booleans()
    | strategies.integers()
    | strategies.floats()
    | strategies.text()
)
_JSON = strategies.recursive(
    _JSON_LEAVES,
    lambda inner: strategies.lists(inner) | strategies.dictionaries(strategies.text(), inner),
    max_leaves=8,
)


@cache
def _integers(low: int, high: int) -> strategies.SearchStrategy[int]:
    return strategies.integers(low, high)


class Choose:
    """Draws for one input."""

    def __init__(self, draw: Callable[[strategies.SearchStrategy[Any]], Any]) -> None:
        self._draw = draw

    def number(self, low: int, high: int) -> int:
        """A whole number from ``low`` to ``high``, both included."""
        return int(self._draw(_integers(low, high))) if high > low else low

    def one_of(self, options: Sequence[T]) -> T:
        return options[self.number(0, len(options) - 1)]

    def chance(self, one_in: int) -> bool:
        return self.number(1, one_in) == 1

    def raw(self, count: int) -> bytes:
        return bytes(self._draw(strategies.binary(min_size=count, max_size=count)))

    def text(self) -> str:
        return str(self._draw(strategies.text(max_size=12)))

    def json(self) -> Any:
        return self._draw(_JSON)


def choices_of(key: str, make: Callable[[Choose], T]) -> T | None:
    """What ``make`` makes of the draws that belong to ``key``; None where they do not suffice."""
    made: list[T] = []

    @strategies.composite
    def built(draw: Callable[[strategies.SearchStrategy[Any]], Any]) -> T:
        return make(Choose(draw))

    @hypothesis.settings(
        database=None, deadline=None, suppress_health_check=list(hypothesis.HealthCheck)
    )
    @hypothesis.given(built())
    def collect(value: T) -> None:
        made.append(value)

    collect.hypothesis.fuzz_one_input(random.Random(key).randbytes(BUFFER_BYTES))  # type: ignore[attr-defined]
    return made[0] if made else None
