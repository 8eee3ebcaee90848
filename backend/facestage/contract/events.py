"""What a running backend says: one JSON object per line on stdout."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass

from facestage.contract.storage import finite

STARTED, PROGRESS, DONE, FAILED = "started", "progress", "done", "failed"


@dataclass(frozen=True)
class Event:
    """One line of progress.

    ``kind``: started, progress, done or failed. ``error`` is the photometric error (RMS, linear) and
    ``fraction`` the share of the work done, 0..1; ``preview`` is the path of the latest picture.
    """

    kind: str
    stage: str = ""
    iteration: int = 0
    error: float | None = None
    seconds: float = 0.0
    seconds_left: float | None = None
    fraction: float = 0.0
    preview: str | None = None
    message: str = ""

    def to_line(self) -> str:
        """The event as one line of JSON without the newline."""
        return json.dumps(finite(asdict(self)))

    @classmethod
    def from_line(cls, line: str) -> Event | None:
        """The event in a line, or None for a line that is not one (a library's own output)."""
        try:
            data = json.loads(line)
        except json.JSONDecodeError:
            return None
        if not isinstance(data, dict) or "kind" not in data:
            return None
        known = {key: value for key, value in data.items() if key in cls.__dataclass_fields__}
        return cls(**known)
