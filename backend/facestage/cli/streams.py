"""Standard output and standard error, which may be full, closed, or listened to by nobody."""

from __future__ import annotations

import os
import sys
from typing import TextIO


def open_missing() -> None:
    """Give closed standard streams a place: otherwise the next file that is opened becomes one of
    them.
    """
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)


def flush_output() -> None:
    """Write what standard output still holds. Raises OSError where that cannot be done."""
    if sys.stdout is not None:
        sys.stdout.flush()


def silence(stream: TextIO | None) -> None:
    """Drop what ``stream`` still holds, since the interpreter would complain of it once more while
    closing.
    """
    try:
        if stream is not None:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    except (OSError, ValueError):
        # One that a caller put in its place, which has no number.
        return


def say(sentence: str) -> None:
    """One line on standard error, if anybody can hear it."""
    try:
        print(f"facestage: {' '.join(sentence.splitlines())}", file=sys.stderr, flush=True)
    except OSError:
        silence(sys.stderr)
