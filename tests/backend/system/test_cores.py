"""Linear algebra takes few threads of a machine with many cores, unless somebody says a number."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

ASKED = """
import os, sys

from facestage.cli import run
from facestage.system import cores

cores.cores = lambda: {cores}
run._prepare_process()
assert "numpy" not in sys.modules, "it asks when it is imported"
if {most}:
    cores.use_algebra_threads({most})
print(os.environ[cores.VARIABLE])
"""


@pytest.mark.parametrize(
    ("said", "count", "most", "threads"),
    [
        (None, 16, 0, "4"),
        (None, 2, 0, "2"),
        (None, 16, 1, "1"),  # a command that has other work for the cores
        ("7", 16, 0, "7"),
        ("7", 16, 1, "7"),
    ],
)
def test_few_threads_multiply_matrices(said: str | None, count: int, most: int, threads: str):
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": said or ""}
    if said is None:
        del environment["OPENBLAS_NUM_THREADS"]
    code = ASKED.format(cores=count, most=most)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment
    )
    assert done.stdout.strip() == threads, done.stderr


WAITS = """
import os, sys

from facestage.cli import run
from facestage.system import cores

run._prepare_process()
assert "numpy" not in sys.modules, "OpenBLAS reads it when numpy is imported"
print(os.environ[cores.WAIT])
"""


@pytest.mark.parametrize(("said", "wait"), [(None, "16"), ("30", "30")])
def test_threads_soon_fall_asleep(said: str | None, wait: str):
    environment = {**os.environ, "OPENBLAS_THREAD_TIMEOUT": said or ""}
    if said is None:
        del environment["OPENBLAS_THREAD_TIMEOUT"]
    done = subprocess.run(
        [sys.executable, "-c", WAITS], capture_output=True, text=True, env=environment
    )
    assert done.stdout.strip() == wait, done.stderr
