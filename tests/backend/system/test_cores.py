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
    ("said", "cores", "most", "threads"),
    [
        (None, 16, 0, "4"),
        (None, 2, 0, "2"),
        (None, 16, 1, "1"),  # a command that has other work for the cores
        ("7", 16, 0, "7"),
        ("7", 16, 1, "7"),
    ],
)
def test_few_threads_multiply_matrices(said: str | None, cores: int, most: int, threads: str):
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": said or ""}
    if said is None:
        del environment["OPENBLAS_NUM_THREADS"]
    code = ASKED.format(cores=cores, most=most)
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment
    )
    assert done.stdout.strip() == threads, done.stderr
