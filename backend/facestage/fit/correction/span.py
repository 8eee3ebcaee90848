"""Which frames are fitted again: asked for, or those around what was corrected."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Int
from facestage.contract.corrections import Correction, joined
from facestage.contract.errors import InputError
from facestage.contract.sequence import Sequence

# Frames further away than this from all corrected ones stay as they were.
SECONDS = 0.5
# Frames that are held on both sides, for second differences to have what they begin from.
BESIDE = 2


@dataclass(frozen=True)
class FrameRange:
    """Numbers of frames, the first and the last."""

    first: int
    last: int

    @classmethod
    def parse(cls, text: str) -> FrameRange:
        """Of the command line: A:B. Raises InputError for anything else."""
        first, colon, last = text.partition(":")
        if not (colon and first.isdecimal() and last.isdecimal() and int(first) <= int(last)):
            raise InputError(
                f"The frames are '{text[:40]}'; expected the numbers of the first and the last, "
                "such as 20:44."
            )
        return cls(int(first), int(last))


@dataclass(frozen=True, eq=False)
class Span:
    """The frames from index ``first`` to before ``end`` of a sequence, with those beside them."""

    first: int
    end: int
    frames: int  # of the whole sequence
    corrections: tuple[Correction, ...]  # all that are known, those outside the range, too

    @property
    def window(self) -> slice:
        """The range with what is held beside it."""
        return slice(max(self.first - BESIDE, 0), min(self.end + BESIDE, self.frames))

    @property
    def indices(self) -> Int[np.ndarray, " frames"]:
        """Those of the window."""
        return np.arange(self.window.start, self.window.stop)

    @property
    def free(self) -> Bool[np.ndarray, " frames"]:
        """Which of the window are of the range."""
        return (self.indices >= self.first) & (self.indices < self.end)


def span_of(
    track: Sequence, corrections: tuple[Correction, ...], frames: FrameRange | None
) -> Span:
    """What ``corrections`` of ``track`` ask for. Raises InputError for what is not of this
    sequence.
    """
    numbers = np.array([frame.number for frame in track.frames])
    for each in corrections:
        if each.frame not in numbers:
            raise InputError(
                f"Frame {each.frame} is corrected, but the sequence has the frames {numbers[0]} to "
                f"{numbers[-1]}; correct one of these."
            )
        for name in each.weights:
            if name not in track.expression_names:
                raise InputError(
                    f"Frame {each.frame} corrects the weight '{name[:60]}', which the sequence "
                    f"does not have; it has {', '.join(track.expression_names[:4])}, ..."
                )
        if not each.weights and each.model_to_camera is None:
            raise InputError(
                f"Frame {each.frame} corrects nothing; give weights, model_to_camera, or both."
            )
    places = [int(np.flatnonzero(numbers == each.frame)[0]) for each in corrections]
    if frames is None:
        reach = max(BESIDE, round(SECONDS * track.frame_rate))
        first, end = max(min(places) - reach, 0), min(max(places) + reach + 1, len(numbers))
    else:
        inside = np.flatnonzero((numbers >= frames.first) & (numbers <= frames.last))
        if not len(inside):
            raise InputError(
                f"No frame has a number from {frames.first} to {frames.last}; the sequence has "
                f"{numbers[0]} to {numbers[-1]}."
            )
        first, end = int(inside[0]), int(inside[-1]) + 1
    outside = [
        each.frame for each, at in zip(corrections, places, strict=True) if not first <= at < end
    ]
    if outside and frames is not None:
        raise InputError(
            f"Frame {outside[0]} is corrected, but is not among the frames {frames.first} to "
            f"{frames.last} that are to be fitted again; let these reach further."
        )
    return Span(first, end, len(numbers), joined(track.corrected, corrections))
