"""What is to be done for a row, one step after another, and who does it: calls that are handed out
to workers as these have room.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from facestage.batch.cluster import Connection
from facestage.batch.film import begin_row, follow_row, join_row
from facestage.batch.task import Readers, Task, fit_row
from facestage.contract.batch import BatchRow
from facestage.contract.files.machine import machine_trouble
from facestage.contract.wording import one_line

# What a worker answers: the row's end, or a number and the seconds that it has taken.
Answer = BatchRow | tuple[int, float]
Call = Callable[[], Answer]


@dataclass
class Course:
    """A row on its way: ``calls`` may be made at once; more follow on their answers."""

    task: Task
    calls: deque[tuple[Any, ...]]  # a function and its arguments
    row: BatchRow | None = None  # once it has ended
    words: str = ""  # how far it is

    def hear(self, answer: Answer) -> None:
        """One of the calls was answered."""
        assert isinstance(answer, BatchRow)
        self._end(answer)

    def _end(self, row: BatchRow) -> None:
        self.row = self.row or row
        self.calls.clear()

    def lose(self, future: Any) -> None:
        """One of the calls came to nothing."""
        error = future.exception() if future.status == "error" else None
        self._end(self.task.failed(one_line(_reason(error))))


@dataclass
class FilmCourse(Course):
    """A film's: it is begun, its pieces are followed, and joined."""

    arguments: tuple[Any, ...] = ()
    pieces: int = 0
    seconds: list[float] = field(default_factory=list)  # of the steps that are done

    def hear(self, answer: Answer) -> None:
        """One of the calls was answered."""
        if isinstance(answer, BatchRow):
            self._end(answer)
            return
        number, seconds = answer
        self.seconds.append(seconds)
        if not self.pieces:
            self.pieces = number
            self.words = f"the person is found, {number} pieces are to be followed."
            self.calls.extend((follow_row, *self.arguments, piece) for piece in range(number))
            return
        done = len(self.seconds) - 1
        self.words = f"{done} of {self.pieces} pieces are followed."
        if done == self.pieces:
            self.calls.append((join_row, *self.arguments, self.seconds))


def course_of(task: Task, read: Readers, out: Path, threads: int) -> Course:
    """Of a row whose result's folder is ``out``; ``threads`` of a worker's renderer."""
    arguments = task, read, out, threads
    if task.film:
        return FilmCourse(task, deque([(begin_row, *arguments)]), arguments=arguments)
    return Course(task, deque([(fit_row, *arguments)]))


def worked(connection: Connection, courses: Iterator[Course], retries: int) -> Iterator[Course]:
    """Each course whenever one of its calls has ended, until all have their rows.

    No more calls are handed out than are worked on at once: a worker that dies counts against all
    that it holds, those that wait included. What was begun comes first.
    """
    from distributed import as_completed

    client = connection.client
    underway: dict[Any, Course] = {}
    begun: deque[Course] = deque()
    ended = as_completed()

    def next_call() -> tuple[Course, tuple[Any, ...]] | None:
        for course in begun:
            if course.calls:
                return course, course.calls.popleft()
        for course in courses:
            begun.append(course)
            return course, course.calls.popleft()
        return None

    def hand_out() -> None:
        # Workers come and go.
        while len(underway) < max(sum(client.nthreads().values()), 1):
            found = next_call()
            if found is None:
                return
            course, (function, *arguments) = found
            future = client.submit(function, *arguments, pure=False, retries=retries)
            underway[future] = course
            ended.add(future)

    hand_out()
    for future in ended:
        course = underway.pop(future)
        told = course.row is not None  # another of its calls has failed
        if future.status == "finished":
            course.hear(future.result())
        else:
            course.lose(future)
        if course.row is not None and course in begun:
            begun.remove(course)
        hand_out()
        if not told:
            yield course


def _reason(error: BaseException | None) -> str:
    """A sentence for a fit that raised ``error``, or None where it was lost."""
    from distributed.scheduler import KilledWorker

    if isinstance(error, KilledWorker):
        times = "once" if error.allowed_failures == 0 else f"{error.allowed_failures + 1} times"
        return (
            f"The process that fitted it died, {times} in all: it may need more memory; give "
            "--memory, fewer --workers, or a smaller photo."
        )
    if error is None:
        return "The scheduler gave it up; run the batch again with --resume."
    return machine_trouble(error) or (
        f"The fit ended with a fault of its own ({type(error).__name__}: {error}); please report "
        "it, with the photo if you can."
    )
