"""Live Link Face: a phone's recording of a face.

The app writes a .csv: a line for each of 60 frames a second, with a timecode and the weights of
ARKit's 52 shapes, of the head and of the eyes.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from facestage.contract.arkit import ARKIT_NAMES
from facestage.contract.arrays import Float
from facestage.contract.errors import InputError
from facestage.contract.files.reading import MIB, read_bytes

TIME = "Timecode"
LARGEST = 512 * MIB  # an hour is 130
DAY = 86400.0
# 13:45:02:17.250: hours, minutes, seconds, frames and thousandths of a frame.
_TIMECODE = re.compile(r"(\d{1,2}):(\d{1,2}):(\d{1,2})[:;](\d{1,3}(?:\.\d+)?)")
RATE = 60.0


@dataclass(frozen=True)
class Recording:
    """What a phone recorded."""

    seconds: Float[np.ndarray, " frames"]  # from the first frame on; they grow
    weights: dict[str, Float[np.ndarray, " frames"]]  # by ARKit's names


def read_recording(path: Path) -> Recording:
    """Read a recording. Raises InputError for what is none."""
    try:
        text = read_bytes(path, "recording", LARGEST).decode("utf-8-sig")
        table = [row for row in csv.reader(text.splitlines()) if row]
    except (UnicodeDecodeError, csv.Error) as error:
        raise _wrong(path, "it is no table") from error
    head = [name.strip() for name in table[0]] if table else []
    # Recordings write EyeBlinkLeft for eyeBlinkLeft, and MouthLeft after it in any order.
    columns = {name[:1].lower() + name[1:]: place for place, name in enumerate(head)}
    known = [name for name in ARKIT_NAMES if name in columns]
    if TIME not in head or not known:
        raise _wrong(path, "its first line names no Timecode and no expressions")
    rows = table[1:]
    if not rows:
        raise _wrong(path, "it has no frames")
    if any(len(row) < len(head) for row in rows):
        raise _wrong(path, "some of its lines are too short")
    try:
        values = np.array([[float(row[columns[name]]) for name in known] for row in rows])
    except ValueError as error:
        raise _wrong(path, f"a weight is no number ({error})") from error
    if not np.isfinite(values).all():
        raise _wrong(path, "a weight is not finite")
    seconds = np.array([_seconds(path, row[head.index(TIME)]) for row in rows])
    seconds = np.unwrap(seconds - seconds[0], period=DAY)  # over midnight
    first = np.concatenate([[True], np.diff(np.maximum.accumulate(seconds)) > 0])
    return Recording(seconds[first], dict(zip(known, values[first].T, strict=True)))


def _seconds(path: Path, text: str) -> float:
    found = _TIMECODE.fullmatch(text.strip())
    if found is None:
        raise _wrong(path, f"'{text[:40]}' is no timecode such as 13:45:02:17.250")
    hours, minutes, seconds, frames = map(float, found.groups())
    return 3600 * hours + 60 * minutes + seconds + frames / RATE


def _wrong(path: Path, why: str) -> InputError:
    return InputError(
        f"'{path}' is no recording of Live Link Face: {why}; choose the .csv that the app shares."
    )
