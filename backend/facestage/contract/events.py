"""What a running backend says: one JSON object per line on stdout."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any

from marshmallow import ValidationError

from facestage.contract.files.json_text import decode_json
from facestage.contract.files.storage import finite
from facestage.contract.schemas.fields import Name, Number, Text, Whole
from facestage.contract.schemas.schema import FileSchema

STARTED, PROGRESS, DONE, FAILED = "started", "progress", "done", "failed"
ITERATION_MAX = 2**63


@dataclass(frozen=True)
class Event:
    """One line of progress.

    ``kind``: started, progress, done or failed. ``error`` is the photometric error (RMS, linear)
    and ``fraction`` the share of the work done, 0..1; ``preview`` is the path of the latest
    picture.
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
            found: dict[str, Any] = EventSchema().load(decode_json(line.encode()))
        except (ValueError, ValidationError):
            return None
        return cls(**found)


class EventSchema(FileSchema):
    """One line of progress; what a newer backend adds is ignored."""

    kind = Name()
    stage = Text(load_default="")
    iteration = Whole(-ITERATION_MAX, ITERATION_MAX, load_default=0)
    error = Number(load_default=None)
    seconds = Number(load_default=0.0)
    seconds_left = Number(load_default=None)
    fraction = Number(0, 1, load_default=0.0)
    preview = Text(load_default=None)
    message = Text(load_default="")
