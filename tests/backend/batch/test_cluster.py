"""How many workers there are, and what cannot be."""

from __future__ import annotations

import sys

import pytest

from facestage.batch.cluster import Pool, connected, default_workers
from facestage.contract.errors import InputError
from facestage.contract.files.reading import GIB


@pytest.mark.parametrize(
    ("cores", "gib", "rows", "count"),
    [(8, 64, 100, 8), (8, 64, 3, 3), (8, 9, 100, 3), (2, 1, 100, 1), (64, 512, 1000, 64)],
)
def test_workers_are_as_many_as_cores_memory_and_rows_allow(
    cores: int, gib: int, rows: int, count: int
):
    assert default_workers(cores, gib * GIB, rows) == count


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"workers": 0}, "--workers is 0"),
        ({"memory_gib": 0.5}, "--memory is 0.5"),
        ({"memory_gib": float("nan")}, "--memory is nan"),
        ({"retries": -1}, "--retries is -1"),
        ({"scheduler": "tcp://x:1", "workers": 2}, "has its own workers"),
    ],
)
def test_what_cannot_be_is_refused(options: dict, words: str):
    with pytest.raises(InputError, match=words):
        Pool(**options)


def test_without_dask_a_sentence_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"needs Dask.*facestage\[batch\]"), connected(Pool(), 1):
        pass


def test_a_scheduler_that_does_not_answer_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("facestage.batch.cluster.CONNECT_SECONDS", 0.2)
    pool = Pool(scheduler="tcp://127.0.0.1:1")
    with pytest.raises(InputError, match=r"answers at 'tcp://127\.0\.0\.1:1'"), connected(pool, 1):
        pass
