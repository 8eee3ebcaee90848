"""What a person at a terminal sees of a fit: one line that moves, then what came of it."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from facestage.contract.events import DONE, Event
from facestage.contract.person import FILE as PERSON
from facestage.contract.person import Person
from facestage.contract.result import Result
from facestage.contract.result_files import PERSON_REPORT, REPORT
from facestage.contract.sequence import Sequence
from facestage.report.tables import error_row

BAR = 24  # characters
# Of a result's errors, those that a person asks for first.
FIGURES = (
    "psnr_skin",
    "landmark_px",
    "similarity_mm",
    "landmark_stage_similarity_mm",
    "covered_mm",
    "landmark_stage_covered_mm",
)


@contextmanager
def listener(as_json: bool) -> Iterator[Callable[[Event], None]]:
    """Who hears of the progress: a line of JSON each, or a terminal's one line.

    Programs and files get JSON, a terminal only where ``as_json`` asks for it.
    """
    if as_json or sys.stdout is None or not sys.stdout.isatty():
        yield lambda event: print(event.to_line(), flush=True)
        return
    line = ProgressLine(sys.stdout)
    try:
        yield line
    finally:
        line.close()


class ProgressLine:
    """Draws each event over the one before, in one line of ``stream``."""

    def __init__(self, stream: TextIO) -> None:
        self._stream, self._drawn = stream, 0
        try:
            "█░".encode(stream.encoding or "ascii")
            self._full, self._empty = "█", "░"
        except (UnicodeEncodeError, LookupError):
            self._full, self._empty = "#", "."

    def __call__(self, event: Event) -> None:
        """Draw ``event``."""
        if event.kind == DONE:
            self.close()
            self._stream.write(f"Done in {event.seconds:.1f} s.\n")
            return
        full = round(BAR * min(max(event.fraction, 0.0), 1.0))
        parts = [
            f"{self._full * full}{self._empty * (BAR - full)} {event.fraction:4.0%}",
            event.message or event.stage,
        ]
        if event.error is not None:
            parts.append(f"photo error {event.error:.4f}")
        if event.seconds_left is not None:
            parts.append(f"{event.seconds_left:.0f} s left")
        # One column stays free: a full line makes some terminals begin another.
        width = max(shutil.get_terminal_size().columns - 1, 1)
        self._draw("  ".join(part for part in parts if part)[:width])

    def close(self) -> None:
        """Take the line away, so that what is said next begins at the left."""
        if self._drawn:
            self._draw("")
            self._stream.write("\r")
            self._stream.flush()

    def _draw(self, text: str) -> None:
        self._stream.write("\r" + text.ljust(self._drawn))
        self._stream.flush()
        self._drawn = len(text)


def summary(out: Path) -> str:
    """What came of the fit into ``out``: its advice, figures, and where its report is."""
    if (out / PERSON).is_file():
        person = Person.load(out)
        lines = [*_sentence(person.advice)]
        for photo in person.photos:
            lines += ["", f"Photo {photo.number}, {Path(photo.image).name}: {photo.status}"]
            lines += _figures(photo.errors)
        return "\n".join([*lines, "", f"Result: {out}", f"Report: {out / PERSON_REPORT}"])
    result = Result.load(out)
    lines = [*_sentence(result.advice), "", *_figures(result.errors)]
    return "\n".join([*lines, "", f"Result: {out}", f"Report: {out / REPORT}"])


def track_summary(out: Path) -> str:
    """What came of tracking into ``out``."""
    track = Sequence.load(out)
    errors = [f"  {value:.3f}".ljust(14) + name for name, value in track.errors.items()]
    lines = [*_sentence(track.advice), "", *errors]
    return "\n".join([*lines, "", f"Result: {out}", f"Report: {out / REPORT}"])


def _sentence(words: str) -> list[str]:
    return textwrap.wrap(words, min(shutil.get_terminal_size().columns - 1, 100) or 1)


def _figures(errors: dict[str, float]) -> list[str]:
    rows = [error_row(key, errors[key]) for key in FIGURES if key in errors]
    return [f"  {row.value} {row.unit}".ljust(14) + row.label for row in rows]
