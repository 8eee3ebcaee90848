"""What a worker of a local cluster does before anything else (Dask's preload)."""

from __future__ import annotations

import signal
from typing import Any


def dask_setup(_worker: Any) -> None:
    """Leave Ctrl+C, which a terminal sends to all processes, to the one that leads the batch."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
