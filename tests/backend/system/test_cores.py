"""Linear algebra takes few threads of a machine with many cores, unless somebody says a number."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from facestage.system.cores import cores

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


WAITED = """
import time

from facestage.cli import run

run._prepare_process()
import numpy as np

matrix = np.ones((300, 300))
for _ in range(20):
    matrix @ matrix
before = time.process_time()
time.sleep(0.3)
print(time.process_time() - before)
"""


@pytest.mark.parametrize(("said", "busy"), [(None, False), ("30", True)])
def test_threads_soon_fall_asleep(said: str | None, busy: bool):
    if cores() < 2:
        pytest.skip("needs two cores: with one, no thread waits for another")
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "2", "OPENBLAS_THREAD_TIMEOUT": said or ""}
    if said is None:
        del environment["OPENBLAS_THREAD_TIMEOUT"]
    done = subprocess.run(
        [sys.executable, "-c", WAITED], capture_output=True, text=True, env=environment
    )
    seconds = float(done.stdout or "nan")
    assert done.returncode == 0, done.stderr
    assert (seconds > 0.05) == busy
