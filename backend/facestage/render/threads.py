"""How many threads trace rays."""

from __future__ import annotations

import drjit


def use_threads(count: int) -> None:
    """Let the CPU renderer use ``count`` threads in this process from now on."""
    if drjit.thread_count() != count:
        drjit.set_thread_count(count)
