"""Memory that was freed, for what is allocated next."""

from __future__ import annotations

import ctypes
import sys

# Of malloc.h of the GNU C library.
TRIM_THRESHOLD, TOP_PAD, MMAP_MAX, ARENA_MAX = -1, -2, -4, -8
LARGEST = 2**31 - 1
GROWTH = 64 << 20  # bytes that the heap grows by at least


def keep_freed_memory() -> bool:
    """Let the process keep what it frees; whether it does.

    The GNU C library gives every large array back to the system, which has to clear its pages anew
    for the next one: a tenth of a fit's seconds. Other systems are left as they are.
    """
    if not sys.platform.startswith("linux"):
        return False
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is None:
        return False
    # One heap for all threads, or each would keep what it frees from the others.
    settings = ((ARENA_MAX, 1), (MMAP_MAX, 0), (TRIM_THRESHOLD, LARGEST), (TOP_PAD, GROWTH))
    return all(mallopt(which, value) == 1 for which, value in settings)


def give_back_freed_memory() -> None:
    """Give the system every page that the process has freed, where its library can: before what is
    large is made, because what is kept lies in pieces too small for it.
    """
    if sys.platform.startswith("linux"):
        trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
        if trim is not None:
            trim(ctypes.c_size_t(0))
