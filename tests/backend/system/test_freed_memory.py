"""Arrays in memory that others have left cost no new pages, and what is free can be given back."""

from __future__ import annotations

import subprocess
import sys

import pytest

ARRAYS = """
import resource
import sys

import numpy as np

from facestage.system.freed_memory import keep_freed_memory

if sys.argv[1] == "kept" and not keep_freed_memory():
    sys.exit(3)


def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt


def use():
    # Too small for huge pages, too large for the heap.
    for _ in range(200):
        np.ones(3 << 20, np.uint8)


use()
before = faults()
use()
print(faults() - before)
"""


def new_pages(how: str) -> int:
    done = subprocess.run(
        [sys.executable, "-c", ARRAYS, how],
        capture_output=True,
        text=True,
        env={"MALLOC_MMAP_THRESHOLD_": "1000000", "PATH": ""},
    )
    if done.returncode == 3:
        pytest.skip("no GNU C library here")
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of the GNU C library")
def test_freed_memory_is_used_again():
    fresh, kept = new_pages("fresh"), new_pages("kept")
    print(f"{fresh} new pages for 200 arrays; {kept} with what is freed kept")
    assert kept < 0.02 * fresh


GIVEN = """
import sys

import numpy as np

from facestage.system.freed_memory import give_back_freed_memory, keep_freed_memory

if not keep_freed_memory():
    sys.exit(3)


def resident():
    with open("/proc/self/statm") as stream:
        return int(stream.read().split()[1])


freed = [np.ones(3 << 20, np.uint8) for _ in range(100)]
last = np.ones(3 << 20, np.uint8)  # keeps the heap from shrinking from its end
full = resident()
del freed
kept = resident()
give_back_freed_memory()
print((full - kept) / full, (full - resident()) / full)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="of the GNU C library")
def test_freed_memory_is_given_back():
    done = subprocess.run([sys.executable, "-c", GIVEN], capture_output=True, text=True)
    if done.returncode == 3:
        pytest.skip("no GNU C library here")
    before, after = map(float, done.stdout.split())
    assert before < 0.1 and after > 0.7
