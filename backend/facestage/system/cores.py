"""How many cores there are, and how many of them multiply matrices: few, whatever the machine has.

OpenBLAS takes one for each core by itself. A fit's matrices are small, so on many cores most of
these threads wait for the others. They wait busily, too, for a tenth of a second after each
product, on cores that trace rays by then: NumPy's own threads, and SciPy's. Nothing here imports
numpy, which asks once, when it is imported.
"""

from __future__ import annotations

import os

VARIABLE = "OPENBLAS_NUM_THREADS"
# On 16 cores a fit is fastest so (docs/install.md).
MOST = 4
WAIT = "OPENBLAS_THREAD_TIMEOUT"
# The binary logarithm of the processor's cycles that a thread waits busily: 20 microseconds, so
# that it is awake for the next product of the same equations.
LONGEST_WAIT = "16"
# What the user said stays.
_SAID = VARIABLE in os.environ


def cores() -> int:
    """How many this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def use_algebra_threads(most: int = MOST) -> None:
    """At most so many, which soon fall asleep, unless the environment says other numbers; before
    numpy is imported.
    """
    if not _SAID:
        os.environ[VARIABLE] = str(min(most, cores()))
    os.environ.setdefault(WAIT, LONGEST_WAIT)
