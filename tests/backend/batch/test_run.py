"""What is said of a fit that gave no answer."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from distributed.scheduler import KilledWorker

from facestage.batch.course import FilmCourse, course_of
from facestage.batch.film import begin_row, follow_row, join_row
from facestage.batch.run import counted
from facestage.batch.task import Readers, Task, fit_row
from facestage.contract.batch import FAILED

WORKER: Any = SimpleNamespace(address="tcp://x:1")
TASK = Task(3, "ann", (Path("/gone/ann.png"),), Namespace(seed=1))
READERS = Readers(lambda _: [], lambda _: SimpleNamespace())  # type: ignore[arg-type, return-value]


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (KilledWorker("fit_row-1", WORKER, 2), "died, 3 times in all"),
        (KilledWorker("fit_row-1", WORKER, 0), "died, once in all"),
        (MemoryError(), "memory is not enough"),
        (PermissionError(13, "Permission denied", "/out"), "'/out'"),
        (TypeError("two\nlines"), "TypeError: two lines"),
        (None, "--resume"),
    ],
)
def test_a_fit_without_an_answer_gets_a_sentence(error: Exception | None, words: str):
    status = "cancelled" if error is None else "error"
    course = course_of(TASK, READERS, Path("/out"), 1)
    assert [call[0] for call in course.calls] == [fit_row]
    course.lose(SimpleNamespace(status=status, exception=lambda: error))
    row = course.row
    assert row is not None and not course.calls
    assert (row.status, row.number, row.name) == (FAILED, 3, "ann")
    assert words in row.sentence and "\n" not in row.sentence


def test_a_batch_is_counted():
    failed, fine = TASK.failed("No."), TASK.row("converged", "Well.", 1.0, {})
    assert counted([fine, failed, fine]) == "2 of 3 fitted, 1 not."
    assert counted([fine]) == "1 of 1 fitted."


def film_course() -> FilmCourse:
    task = Task(1, "take", (Path("/gone/take.mp4"),), Namespace(chunk=24), film=True)
    course = course_of(task, READERS, Path("/out"), 1)
    assert isinstance(course, FilmCourse)
    assert [call[0] for call in course.calls] == [begin_row]
    course.calls.clear()
    return course


def test_a_film_is_begun_followed_in_pieces_and_joined():
    course = film_course()
    course.hear((3, 5.0))
    assert [(call[0], call[-1]) for call in course.calls] == [(follow_row, n) for n in range(3)]
    assert "3 pieces" in course.words
    course.calls.clear()
    for seconds in (1.0, 2.0):
        course.hear((1, seconds))
        assert not course.calls, "a piece is missing"
    assert course.words.startswith("2 of 3")
    course.hear((1, 4.0))
    (call,) = course.calls
    assert call[0] is join_row and call[-1] == [5.0, 1.0, 2.0, 4.0]
    done = course.task.row("converged", "Well.", 12.0, {})
    course.hear(done)
    assert course.row is done


def test_a_film_whose_piece_is_lost_has_failed_once():
    course = film_course()
    course.hear((3, 5.0))
    course.lose(SimpleNamespace(status="error", exception=lambda: KilledWorker("x", WORKER, 2)))
    row = course.row
    assert row is not None and row.failed and "died, 3 times" in row.sentence
    assert not course.calls
    # The others, which were underway, change nothing.
    course.hear((1, 1.0))
    course.hear((1, 1.0))
    course.lose(SimpleNamespace(status="error", exception=MemoryError))
    assert course.row is row and not course.calls


def test_a_film_that_needs_no_pieces_is_done_at_once():
    course = film_course()
    done = course.task.row("converged", "Well.", 3.0, {})
    course.hear(done)
    assert course.row is done and not course.calls
