"""One whole batch: rows in, a folder of results, a table and a page out, events on the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from facestage.batch.cluster import Connection, Pool, connected
from facestage.batch.course import Course, course_of, worked
from facestage.batch.summary import write_summary
from facestage.batch.task import Readers, Task
from facestage.contract.batch import FITS, JOURNAL, BatchRow, read_journal
from facestage.contract.errors import InputError
from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.contract.files.atomic import atomic_file
from facestage.contract.files.partial import MARKER, forget_checkpoint, partial_folder
from facestage.contract.person import FILE as PERSON
from facestage.contract.result import FILE as RESULT
from facestage.contract.sequence import FILE as SEQUENCE
from facestage.report.batch_page import write_batch_report

LOCK = ".facestage-batch-lock"
STAGE = "batch"


def run_batch(
    tasks: Sequence[Task],
    read: Readers,
    out: Path,
    pool: Pool,
    resume: bool = False,
    emit: Callable[[Event], None] = lambda event: None,
) -> list[BatchRow]:
    """Fit ``tasks`` into ``out``, and return what came of each, in their order.

    ``resume``: what an earlier batch in ``out`` has done is left, and what it has begun is gone on
    with. What is wrong with a row is said in the row; InputError is raised for what is wrong with
    all.
    """
    out, started = Path(out).resolve(), time.monotonic()
    with _claimed(out):
        rows = _done(tasks, out) if resume else _afresh(tasks, out)
        ahead = [task for task in tasks if task.name not in rows]
        emit(Event(STARTED, STAGE, message=f"{len(ahead)} of {len(tasks)} rows to fit"))
        try:
            if ahead:
                with connected(pool, len(ahead)) as connection:
                    teller = _Teller(emit, len(tasks), len(rows), started)
                    teller.connected(connection)
                    courses = (
                        course_of(task, read, out / FITS / task.name, connection.threads)
                        for task in ahead
                    )
                    for course in worked(connection, courses, pool.retries):
                        row = course.row
                        if row is None:
                            teller.went_on(course)
                            continue
                        rows[row.name] = row
                        _note(row, out)
                        teller.ended(row)
        finally:
            # Of a batch that is stopped, too.
            ordered = [rows[task.name] for task in tasks if task.name in rows]
            write_summary(out, ordered)
            write_batch_report(out, ordered, len(tasks), time.monotonic() - started)
    seconds = time.monotonic() - started
    emit(Event(DONE, STAGE, len(ordered), seconds=seconds, fraction=1.0, message=counted(ordered)))
    return ordered


def counted(rows: Sequence[BatchRow]) -> str:
    """How many rows were fitted, and how many were not, as a sentence."""
    failed = sum(row.failed for row in rows)
    words = f"{len(rows) - failed} of {len(rows)} fitted"
    return f"{words}, {failed} not." if failed else f"{words}."


@contextmanager
def _claimed(out: Path) -> Iterator[None]:
    """Hold ``out`` against other batches. Raises InputError where it is somebody else's."""
    if out.exists() and not out.is_dir():
        raise InputError(f"The output '{out}' is a file; expected a folder name.")
    if out.is_dir() and any(out.iterdir()) and not (out / JOURNAL).is_file():
        raise InputError(
            f"The output folder '{out}' holds files that are not a batch; choose a new or empty "
            "folder."
        )
    try:
        (out / FITS).mkdir(parents=True, exist_ok=True)
        (out / JOURNAL).touch()
        lock = FileLock(out / LOCK, timeout=0)
        lock.acquire()
    except Timeout:
        raise InputError(
            f"Another batch is writing into '{out}'; wait until it is done, or choose another "
            "--out."
        ) from None
    except OSError as error:
        raise InputError(
            f"Cannot write into '{out}' ({error.strerror or error}); choose a folder that you may "
            "write to."
        ) from error
    try:
        yield
    finally:
        (out / LOCK).unlink(missing_ok=True)
        lock.release()


def _done(tasks: Sequence[Task], out: Path) -> dict[str, BatchRow]:
    """What the journal has of ``tasks`` as they are now, and has a result, by name."""
    journal = read_journal(out)
    with atomic_file(out / JOURNAL) as temporary:  # without what a kill cut off
        temporary.write_text("".join(f"{row.to_line()}\n" for row in journal.values()), "utf-8")
    found = {}
    for task in tasks:
        row, folder = journal.get(task.name), out / FITS / task.name
        there = any((folder / file).is_file() for file in (RESULT, PERSON, SEQUENCE))
        if row is not None and not row.failed and there and row.asked == task.asked:
            found[task.name] = row
    return found


def _afresh(tasks: Sequence[Task], out: Path) -> dict[str, BatchRow]:
    """Forget the journal and the checkpoints of an earlier batch; no row is done."""
    (out / JOURNAL).write_bytes(b"")
    for task in tasks:
        partial = partial_folder(out / FITS / task.name)
        if (partial / MARKER).is_file():
            forget_checkpoint(partial)
    return {}


def _note(row: BatchRow, out: Path) -> None:
    """Add a line to the journal."""
    with (out / JOURNAL).open("a", encoding="utf-8") as stream:
        stream.write(row.to_line() + "\n")


class _Teller:
    """Says how far the batch is, row by row."""

    def __init__(
        self, emit: Callable[[Event], None], total: int, done: int, started: float
    ) -> None:
        self._emit, self._total, self._done, self._started = emit, total, done, started
        self._before, self._failed = done, 0

    def connected(self, connection: Connection) -> None:
        count = connection.workers
        words = f"{count} worker{'' if count == 1 else 's'}"
        self._tell(f"{words}; Dask's dashboard: {connection.dashboard}")

    def ended(self, row: BatchRow) -> None:
        self._done += 1
        self._failed += row.failed
        words = f"{self._done} of {self._total}"
        if self._failed:
            words += f", {self._failed} failed"
        self._tell(f"{words}; {row.name}: {row.sentence}")

    def went_on(self, course: Course) -> None:
        """A step of a film is done."""
        self._tell(f"{self._done} of {self._total}; {course.task.name}: {course.words}")

    def _tell(self, message: str) -> None:
        seconds = time.monotonic() - self._started
        new = self._done - self._before
        left = seconds / new * (self._total - self._done) if new else None
        self._emit(
            Event(
                PROGRESS,
                STAGE,
                self._done,
                seconds=seconds,
                seconds_left=left,
                fraction=self._done / self._total,
                message=message,
            )
        )
