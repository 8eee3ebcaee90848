"""Where to look for faces: frames, tiles and turns of a photo in which the detector can see them.

The detector finds faces a sixth to nine tenths as wide as its square, rolled up to about 45 degrees
for sure.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from facestage.landmarks.crop import Crop
from facestage.landmarks.face_detector import (
    Detections,
    FaceDetector,
    concatenate,
    merge_overlapping,
)
from facestage.landmarks.views import PhotoViews

QUARTER_TURNS = (0.0, np.pi / 2, np.pi, -np.pi / 2)
# A portrait that the frame cuts is seen whole in a square wider than the photo.
FRAMES = (1.0, 2.0)
# The smallest tiles are the longer side over this: a panorama eight times as long as high is still
# searched.
DIVISION_MAX = 16
# Side of the square around a face, over its box, in which the detector is surest of it.
CLOSE = 2.5
# How far the same face may seem to move, in widths of its box, when looked at more closely.
SAME_FACE = 0.5


def coarse_windows(width: int, height: int) -> list[Crop]:
    """The whole photo in all quarter turns, and tiles half its size: faces of a twelfth of its
    longer side up.
    """
    whole = [
        Crop(center, side * factor, turn)
        for center, side in [_frame(width, height)]
        for factor in FRAMES
        for turn in QUARTER_TURNS
    ]
    return whole + tiles(width, height, 2)


def fine_windows(width: int, height: int) -> list[Crop]:
    """Where to look when nothing was found: turned tiles, and smaller ones; in a long photo ever
    smaller ones.
    """
    turned = [
        replace(tile, angle=turn) for turn in QUARTER_TURNS[1:] for tile in tiles(width, height, 2)
    ]
    division = 4
    small = tiles(width, height, division)
    while division < DIVISION_MAX and max(width, height) / division > min(width, height):
        division *= 2
        small += tiles(width, height, division)
    return turned + small


def tiles(width: int, height: int, division: int) -> list[Crop]:
    """Squares of the longer side over ``division`` that overlap by half and cover the photo."""
    side = max(width, height) / division
    across, down = (_centers(extent, side) for extent in (width, height))
    return [Crop(np.array([x, y]), side) for y in down for x in across]


def _frame(width: int, height: int) -> tuple[np.ndarray, float]:
    return np.array([width, height]) / 2, float(max(width, height))


def _centers(extent: float, side: float) -> np.ndarray:
    if extent <= side:
        return np.array([extent / 2])
    count = int(np.ceil((extent - side) / (side / 2) - 1e-9)) + 1
    return np.linspace(side / 2, extent - side / 2, count)


def find_candidates(detector: FaceDetector, views: PhotoViews, windows: list[Crop]) -> Detections:
    """Where faces may be, the surest first."""
    found = merge_overlapping(concatenate([detector.detect(views, window) for window in windows]))
    return found.select(np.argsort(-found.scores, kind="stable"))


def look_closely(detector: FaceDetector, views: PhotoViews, candidate: Detections) -> Detections:
    """One candidate seen alone in all quarter turns: the surest of what is found at its place, or
    nothing.

    The detector also takes a face that stands on its head for one, but is less sure of it.
    """
    x, y, side = candidate.boxes[0]
    parts = []
    for turn in QUARTER_TURNS:
        crop = Crop(np.array([x, y]), CLOSE * side, float(candidate.roll[0]) + turn)
        parts.append(merge_overlapping(detector.detect(views, crop)))
    found = concatenate(parts)
    near = np.abs(found.boxes[:, :2] - [x, y]).max(axis=1, initial=0.0) < SAME_FACE * side
    found = found.select(near)
    return found.select(np.argsort(-found.scores, kind="stable")[:1])
