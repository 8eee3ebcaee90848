"""How many cores there are, and how many of them multiply matrices: few, whatever the machine has.

OpenBLAS takes one for each core by itself. A fit's matrices are small, so on many cores most of
these threads wait for the others, and do it busily. Nothing here imports numpy, which asks once,
when it is imported.
"""

from __future__ import annotations

import os

VARIABLE = "OPENBLAS_NUM_THREADS"
# On 16 cores a fit is fastest so (docs/install.md).
MOST = 4
# What the user said stays.
_SAID = VARIABLE in os.environ


def cores() -> int:
    """How many this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def use_algebra_threads(most: int = MOST) -> None:
    """At most so many, unless the environment says a number; before numpy is imported."""
    if not _SAID:
        os.environ[VARIABLE] = str(min(most, cores()))
