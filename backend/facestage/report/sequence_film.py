"""A film of photo beside fit: one animated picture, for a browser to play."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float, UInt8

QUALITY, EFFORT = 70, 2
# Seconds for which a frame is shown: a film of which only some are shown plays faster than it was.
SHORTEST, LONGEST = 0.02, 0.1
# Haemoglobin that is shown in full color, in standard deviations of a population; linear RGB.
BLOOD_FULL, RED, BLUE = 2.0, (0.7, 0.02, 0.02), (0.03, 0.12, 0.8)


@dataclass(frozen=True, eq=False)
class ShownFrame:
    """A frame beside its fit, sRGB."""

    number: int
    time: float  # seconds since the film's first
    photo: UInt8[np.ndarray, "side side 3"]
    fit: UInt8[np.ndarray, "side side 3"]
    blood: UInt8[np.ndarray, "side side 3"] | None = None  # see blood_picture, where it changes

    @property
    def pictures(self) -> tuple[UInt8[np.ndarray, "side side 3"], ...]:
        """All that there are."""
        return (self.photo, self.fit) if self.blood is None else (self.photo, self.fit, self.blood)


def blood_picture(
    photo: Float[np.ndarray, "height width 3"], haemoglobin: Float[np.ndarray, "height width"]
) -> Float[np.ndarray, "height width 3"]:
    """A linear ``photo`` in grey, red where the skin has more of it, blue where less: nothing else
    from BLOOD_FULL standard deviations on.
    """
    grey = np.repeat(photo.mean(axis=-1, keepdims=True), 3, axis=-1)
    share = np.clip(haemoglobin / BLOOD_FULL, -1.0, 1.0)[..., None]
    return grey + np.abs(share) * (np.where(share > 0, RED, BLUE) - grey)


def film_of(frames: Sequence[ShownFrame]) -> bytes:
    """The ``frames`` as an animated WebP, photo left and fit right, over and over; right of them
    haemoglobin, where it changes.
    """
    from PIL import Image

    first, *rest = (Image.fromarray(np.concatenate(frame.pictures, axis=1)) for frame in frames)
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
