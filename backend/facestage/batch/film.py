"""A row that is a film, in steps, each in the process that takes it: the film is begun, its pieces
are followed apart, and joined.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from facestage.batch.task import Readers, Task
from facestage.contract.batch import BatchRow
from facestage.contract.errors import FacestageError, InputError
from facestage.contract.files.partial import has_checkpoint, partial_folder
from facestage.contract.sequence import Sequence as Track
from facestage.fit.sequence.request import Request


def begin_row(task: Task, read: Readers, out: Path, threads: int) -> BatchRow | tuple[int, float]:
    """The row of a film that is bad, or so short that one process follows it; else in how many
    pieces it is to be followed, and the seconds that this has taken.
    """

    def work(request: Request) -> Track | int:
        from facestage.fit.pieces.run import begin_film

        most, finder = task.options.chunk, task.options.landmark_model
        if has_checkpoint(partial_folder(out)):
            try:
                return begin_film(request, out, most, True, finder)
            except InputError:
                pass  # it may be of other options, or damaged: the film itself says what is wrong
        return begin_film(request, out, most, False, finder)

    return _tried(task, read, threads, work)


def follow_row(
    task: Task, read: Readers, out: Path, threads: int, number: int
) -> BatchRow | tuple[int, float]:
    """Follow the piece ``number``; how many are followed by that, and in how many seconds."""

    def work(request: Request) -> int:
        from facestage.fit.pieces.run import follow_piece

        follow_piece(request, out, task.options.chunk, number)
        return 1

    return _tried(task, read, threads, work)


def join_row(
    task: Task, read: Readers, out: Path, threads: int, seconds: Sequence[float]
) -> BatchRow | tuple[int, float]:
    """The row of a film whose pieces are followed. ``seconds``: what the steps have taken."""

    def work(request: Request) -> Track:
        from facestage.fit.pieces.run import join_film

        timings = {"begun": seconds[0], "pieces": sum(seconds[1:])}
        return join_film(request, out, task.options.chunk, timings)

    row = _tried(task, read, threads, work)
    assert isinstance(row, BatchRow)
    return replace(row, seconds=row.seconds + sum(seconds))


def _tried(
    task: Task, read: Readers, threads: int, work: Callable[[Request], Track | int]
) -> BatchRow | tuple[int, float]:
    from facestage.render.threads import use_threads

    started = time.monotonic()
    use_threads(threads)
    try:
        found = work(replace(read.request(task.options), content=task.asked))
    except FacestageError as error:
        return task.failed(str(error), time.monotonic() - started)
    seconds = time.monotonic() - started
    if isinstance(found, int):
        return found, seconds
    return task.row(found.status, found.advice, seconds, found.errors)
