"""A batch: what came of each row of a manifest, as lines of JSON in the batch's folder.

A line is added as a row ends, so that a batch that was stopped knows what is done.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from marshmallow import ValidationError

from facestage.contract.files.json_text import decode_json
from facestage.contract.files.paths import is_file
from facestage.contract.files.reading import MIB, read_bytes
from facestage.contract.files.storage import finite
from facestage.contract.result import STATUSES
from facestage.contract.schemas.fields import (
    Choice,
    Figures,
    Items,
    Name,
    Number,
    PathText,
    Text,
    Whole,
)
from facestage.contract.schemas.schema import FileSchema

JOURNAL, SUMMARY, FITS = "batch.jsonl", "summary.csv", "fits"
FAILED = "failed"  # no result; beside a result's own statuses
ROWS_MAX = 100_000
JOURNAL_MAX = 512 * MIB


@dataclass(frozen=True)
class BatchRow:
    """What came of one row: a fit of one photo, or of several of one person."""

    number: int  # of the row, 1 for the first
    name: str  # of its result folder in FITS
    photos: tuple[str, ...]  # paths
    status: str  # a result's, or FAILED
    sentence: str  # what the fit says, or why there is none
    asked: str  # a digest of what was asked; another one is another fit
    seconds: float = 0.0
    errors: dict[str, float] = field(default_factory=dict)  # as a result's; means of several photos

    @property
    def failed(self) -> bool:
        """Whether there is no result."""
        return self.status == FAILED

    def to_line(self) -> str:
        """The row as one line of JSON without the newline."""
        return json.dumps(finite(asdict(self)))

    @classmethod
    def from_line(cls, line: bytes) -> BatchRow | None:
        """The row in a line, or None for a line that is not one, as where a disk was full."""
        try:
            found: dict[str, Any] = BatchRowSchema().load(decode_json(line))
        except (ValueError, ValidationError):
            return None
        return cls(**found)


def read_journal(folder: Path) -> dict[str, BatchRow]:
    """What came of the rows of the batch in ``folder``, by name; the last line of a name counts."""
    path = folder / JOURNAL
    if not is_file(path):
        return {}
    lines = read_bytes(path, "batch's journal", JOURNAL_MAX).splitlines()
    rows = (BatchRow.from_line(line) for line in lines)
    return {row.name: row for row in rows if row is not None}


class BatchRowSchema(FileSchema):
    """A line of a journal."""

    number = Whole(1, ROWS_MAX)
    name = Name()
    photos = Items(PathText(), 1)
    status = Choice((*STATUSES, FAILED))
    sentence = Text()
    asked = Text()
    seconds = Number(0)
    errors = Figures()
