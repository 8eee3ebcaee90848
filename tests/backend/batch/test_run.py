"""What is said of a fit that gave no answer."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from distributed.scheduler import KilledWorker

from facestage.batch.run import _row, counted
from facestage.batch.task import Task
from facestage.contract.batch import FAILED

WORKER: Any = SimpleNamespace(address="tcp://x:1")
TASK = Task(3, "ann", (Path("/gone/ann.png"),), Namespace(seed=1))


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
    row = _row(TASK, SimpleNamespace(status=status, exception=lambda: error))
    assert (row.status, row.number, row.name) == (FAILED, 3, "ann")
    assert words in row.sentence and "\n" not in row.sentence


def test_a_batch_is_counted():
    failed, fine = TASK.failed("No."), TASK.row("converged", "Well.", 1.0, {})
    assert counted([fine, failed, fine]) == "2 of 3 fitted, 1 not."
    assert counted([fine]) == "1 of 1 fitted."
