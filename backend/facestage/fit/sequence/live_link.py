"""A sequence as the CSV that Apple's ARKit and Epic's Live Link Face speak: 52 weights a frame."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.sequence import SequenceFrame

_SIDED = (
    *("EyeBlink", "EyeLookDown", "EyeLookIn", "EyeLookOut", "EyeLookUp", "EyeSquint", "EyeWide"),
    *("MouthSmile", "MouthFrown", "MouthDimple", "MouthStretch", "MouthPress", "MouthLowerDown"),
    *("MouthUpperUp", "BrowDown", "BrowOuterUp", "CheekSquint", "NoseSneer"),
)
_MIDDLE = (
    *("JawForward", "JawRight", "JawLeft", "JawOpen", "MouthClose", "MouthFunnel", "MouthPucker"),
    *("MouthRight", "MouthLeft", "MouthRollLower", "MouthRollUpper", "MouthShrugLower"),
    *("MouthShrugUpper", "BrowInnerUp", "CheekPuff", "TongueOut"),
)
WEIGHTS = (*(f"{name}{side}" for name in _SIDED for side in ("Left", "Right")), *_MIDDLE)
ANGLES = tuple(
    f"{part}{angle}"
    for part in ("Head", "LeftEye", "RightEye")
    for angle in ("Yaw", "Pitch", "Roll")
)
# A model that knows fewer of the weights speaks another language.
KNOWN_MIN = 40


def live_link_csv(
    names: Sequence[str],
    weights: Float[np.ndarray, "frames expressions"],
    frames: Sequence[SequenceFrame],
    turns: Float[np.ndarray, "frames 3"],
    rate: float,
) -> str | None:
    """The CSV; None where too few of the model's ``names`` are ARKit's.

    ``turns``: yaw, pitch and roll of the head in radians. A weight that the model has for each side
    alone is the mean of both; where eyes look is in their weights, the angles of eyes are 0.
    """
    columns = {_plain(name): index for index, name in enumerate(names)}
    found = {name: _columns(name, columns) for name in WEIGHTS}
    if sum(bool(one) for one in found.values()) < KNOWN_MIN:
        return None
    text = io.StringIO(newline="")
    table = csv.writer(text)
    table.writerow(["Timecode", "BlendshapeCount", *WEIGHTS, *ANGLES])
    for row, frame, turn in zip(weights, frames, turns, strict=True):
        values = [float(row[one].mean()) if one else 0.0 for one in found.values()]
        angles = [*turn, *[0.0] * (len(ANGLES) - len(turn))]
        cells = [f"{value:.6f}" for value in (*values, *angles)]
        table.writerow([_timecode(frame.time, rate), len(WEIGHTS) + len(ANGLES), *cells])
    return text.getvalue()


def _plain(name: str) -> str:
    """A name without its spelling: eyeBlink_L and EyeBlinkLeft are one."""
    for short, side in (("_L", "Left"), ("_R", "Right")):
        if name.endswith(short):
            name = name.removesuffix(short) + side
    return name.lower()


def _columns(name: str, columns: dict[str, int]) -> list[int]:
    name = name.lower()
    whole = [columns[name]] if name in columns else []
    return whole or [columns[name + side] for side in ("left", "right") if name + side in columns]


def _timecode(seconds: float, rate: float) -> str:
    whole = int(seconds + 1e-6)
    frame = (seconds - whole) * rate
    return f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}:{max(frame, 0.0):06.3f}"
