"""A film: a video, or a folder of numbered pictures, read frame by frame."""

from __future__ import annotations

import re
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.grey import CLIP_LEVEL
from facestage.contract.job import PHOTO_SUFFIXES
from facestage.images.color_profile import DEFAULT
from facestage.images.image_io import Photograph, read_photograph
from facestage.images.opencv import opencv
from facestage.images.quiet import quiet_standard_error

DEFAULT_RATE = 24.0  # of a folder, frames a second
RATE_MIN, RATE_MAX = 0.1, 1000.0
FRAMES_MIN, FRAMES_MAX = 3, 200_000
DIGITS = re.compile(r"(\d+)")


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of a film; ``index`` counts from 0, ``number`` is what an artist calls it."""

    index: int
    number: int
    time: float  # seconds since the first frame
    name: str
    photograph: Photograph


class Film:
    """Reads ``path``; every walk over its frames reads it anew, so memory holds one of them."""

    def __init__(self, path: Path, rate: float | None = None) -> None:
        """``rate``: frames a second of a folder. Raises InputError for what is no film."""
        self.path = path
        self._start, self._stop = 0, FRAMES_MAX
        if rate is not None and not RATE_MIN <= rate <= RATE_MAX:
            raise InputError(
                f"The frame rate is {rate:g}; expected {RATE_MIN:g} to {RATE_MAX:g} a second."
            )
        if not path.exists():
            raise InputError(
                f"There is no video or folder '{path}'; give a video file, or a folder of pictures."
            )
        self._pictures = _pictures(path) if path.is_dir() else []
        if path.is_dir():
            self.rate, self._numbers = rate or DEFAULT_RATE, _numbers(self._pictures)
        else:
            if rate is not None:
                raise InputError(
                    f"'{path}' is a video, which has its own times; leave out --rate, which is for "
                    "a folder of pictures."
                )
            self.rate = _video_rate(path)

    @property
    def count(self) -> int | None:
        """How many frames there are; None where only reading tells."""
        if self._pictures:
            return len(self._pictures[self._start : self._stop])
        return self._stop - self._start if self._stop < FRAMES_MAX else None

    def part(self, start: int, stop: int) -> Film:
        """The frames from index ``start`` to before ``stop``, all of which there are, as a film of
        their own: indices are from its first on, numbers and times as they were.
        """
        part = copy(self)
        part._start, part._stop = start, stop
        return part

    def picture(self, index: int) -> Path | None:
        """The file of a folder's frame; None for a video's."""
        return self._pictures[self._start + index] if self._pictures else None

    def frames(self, first: int = 0) -> Iterator[Frame]:
        """The frames from index ``first`` on. Raises InputError for one that cannot be read, or has
        another size.
        """
        size: tuple[int, int] | None = None
        first += self._start
        for frame in self._folder(first) if self._pictures else self._video(first):
            if frame.index >= self._stop:
                return
            size = size or frame.photograph.size
            if frame.photograph.size != size:
                raise InputError(
                    f"Frame '{frame.name}' of '{self.path}' has {_by(frame.photograph.size)} "
                    f"pixels and those before {_by(size)}; give frames of one size."
                )
            yield replace(frame, index=frame.index - self._start)

    def _folder(self, first: int) -> Iterator[Frame]:
        for index in range(first, len(self._pictures)):
            picture, number = self._pictures[index], self._numbers[index]
            time = (number - self._numbers[0]) / self.rate
            yield Frame(index, number, time, picture.name, read_photograph(picture))

    def _video(self, first: int) -> Iterator[Frame]:
        cv2 = opencv()
        video = _opened(self.path)
        start, last = None, -1.0
        try:
            for index in range(FRAMES_MAX):
                if not video.grab():
                    return
                shown = video.get(cv2.CAP_PROP_POS_MSEC) / 1e3
                start = shown if start is None else start
                # A container without times, or with wrong ones, counts frames.
                time = shown - start if shown - start > last else last + 1.0 / self.rate
                last = time
                if index < first:
                    continue
                decoded, codes = video.retrieve()
                if not decoded:
                    return
                yield Frame(index, index + 1, time, f"{index + 1}", _photograph(codes[..., ::-1]))
        finally:
            video.release()


def _photograph(codes: np.ndarray) -> Photograph:
    """Of display-referred (h, w, 3) bytes, taken for sRGB as players do."""
    codes = np.ascontiguousarray(codes)
    clipped = codes >= CLIP_LEVEL * np.iinfo(codes.dtype).max
    return Photograph(DEFAULT(codes), np.ones(codes.shape[:2], bool), clipped)


def _pictures(folder: Path) -> list[Path]:
    """The pictures of a folder in natural order: 2 before 10."""
    found = [
        path
        for path in folder.iterdir()
        if path.suffix.lower() in PHOTO_SUFFIXES and not path.name.startswith(".")
    ]
    if not FRAMES_MIN <= len(found) <= FRAMES_MAX:
        raise InputError(
            f"The folder '{folder}' holds {len(found)} pictures, expected {FRAMES_MIN} to "
            f"{FRAMES_MAX} ({', '.join(PHOTO_SUFFIXES)})."
        )
    return sorted(found, key=lambda path: _natural(path.name))


def _natural(name: str) -> list[tuple[int, int, str]]:
    parts = DIGITS.split(name.lower())
    return [(0, int(part), "") if part.isdigit() else (1, 0, part) for part in parts]


def _numbers(pictures: list[Path]) -> list[int]:
    """What the names count, where they do; else 1, 2, ..."""
    found = [DIGITS.findall(path.stem) for path in pictures]
    plain = list(range(1, len(pictures) + 1))
    if not all(found):
        return plain
    numbers = [int(digits[-1]) for digits in found]
    rising = all(b > a for a, b in pairwise(numbers))
    # Names such as dates leave gaps that are none in time.
    return numbers if rising and numbers[-1] - numbers[0] < 4 * len(numbers) else plain


def _opened(path: Path) -> Any:
    cv2 = opencv()
    with quiet_standard_error():
        video = cv2.VideoCapture(str(path))
    if not video.isOpened():
        video.release()
        raise InputError(
            f"'{path}' is not a video that can be read here; convert it (to MP4, H.264), or give a "
            "folder of pictures."
        )
    video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
    return video


def _video_rate(path: Path) -> float:
    cv2 = opencv()
    video = _opened(path)
    rate = float(video.get(cv2.CAP_PROP_FPS))
    video.release()
    return rate if RATE_MIN <= rate <= RATE_MAX else DEFAULT_RATE


def _by(size: tuple[int, int]) -> str:
    return f"{size[0]} x {size[1]}"
