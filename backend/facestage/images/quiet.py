"""Libraries of C that write to standard error what is said once, by the error that they raise."""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterator


@contextlib.contextmanager
def quiet_standard_error() -> Iterator[None]:
    """What is written to the process's standard error meanwhile is lost."""
    try:
        sys.stderr.flush()
        kept = os.dup(2)
    # There is none, as in a program without a console.
    except (AttributeError, OSError, ValueError):
        yield
        return
    try:
        with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 - a device, by its name on each system
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
