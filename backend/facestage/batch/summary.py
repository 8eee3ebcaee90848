"""The table that a batch leaves: summary.csv."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from facestage.contract.batch import FITS, SUMMARY, BatchRow
from facestage.contract.files.atomic import atomic_file
from facestage.report.batch_page import picture_of

# Of a result's errors, and of a sequence's.
ERRORS = (
    "psnr_skin",
    "photo_rms",
    "landmark_px",
    "similarity_mm",
    "landmark_stage_similarity_mm",
    "rigid_mm",
    "covered_mm",
    "frame_similarity_mm",
    "jitter_ratio",
    "lag_frames",
)


def write_summary(out: Path, rows: Sequence[BatchRow]) -> None:
    """Write a line for each row: status, errors as far as they are known, seconds, picture and
    sentence. Paths are relative to ``out``, but for the photos'.
    """
    head = ("row", "name", "photo", "status", *ERRORS, "seconds", "result", "picture", "sentence")
    with (
        atomic_file(out / SUMMARY) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as stream,
    ):
        table = csv.writer(stream)
        table.writerow(head)
        table.writerows(_cells(out, row) for row in rows)


def _cells(out: Path, row: BatchRow) -> list[str]:
    errors = [f"{row.errors[name]:.6g}" if name in row.errors else "" for name in ERRORS]
    picture = None if row.failed else picture_of(out, row)
    return [
        str(row.number),
        row.name,
        ";".join(row.photos),
        row.status,
        *errors,
        f"{row.seconds:.1f}",
        "" if row.failed else f"{FITS}/{row.name}",
        picture.relative_to(out).as_posix() if picture else "",
        row.sentence,
    ]
