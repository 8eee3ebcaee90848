"""A film of photo beside fit: one animated picture, for a browser to play."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import UInt8

QUALITY, EFFORT = 70, 2
# Seconds for which a frame is shown: a film of which only some are shown plays faster than it was.
SHORTEST, LONGEST = 0.02, 0.1


@dataclass(frozen=True, eq=False)
class ShownFrame:
    """A frame beside its fit, sRGB."""

    number: int
    time: float  # seconds since the film's first
    photo: UInt8[np.ndarray, "side side 3"]
    fit: UInt8[np.ndarray, "side side 3"]


def film_of(frames: Sequence[ShownFrame]) -> bytes:
    """The ``frames`` as an animated WebP, photo left and fit right, over and over."""
    from PIL import Image

    first, *rest = (
        Image.fromarray(np.concatenate([frame.photo, frame.fit], axis=1)) for frame in frames
    )
    file = io.BytesIO()
    milliseconds = round(1e3 * seconds_each(frames))
    first.save(
        file,
        format="WEBP",
        save_all=True,
        append_images=rest,
        duration=milliseconds,
        loop=0,
        quality=QUALITY,
        method=EFFORT,
    )
    return file.getvalue()


def seconds_each(frames: Sequence[ShownFrame]) -> float:
    """How long a frame is shown: as long as it was, within what is good to look at."""
    if len(frames) < 2:
        return LONGEST
    usual = (frames[-1].time - frames[0].time) / (len(frames) - 1)
    return float(np.clip(usual, SHORTEST, LONGEST))


def pace_of(frames: Sequence[ShownFrame]) -> float:
    """How many times as fast as it was the film plays."""
    if len(frames) < 2:
        return 1.0
    return (frames[-1].time - frames[0].time) / (len(frames) - 1) / seconds_each(frames)
