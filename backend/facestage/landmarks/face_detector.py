"""BlazeFace, short range (Bazarevsky et al. 2019): boxes and six key points of the faces in a
square.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.images.opencv import opencv
from facestage.landmarks.crop import Crop
from facestage.landmarks.views import PhotoViews

SIZE = 128  # pixels of the network's input
STRIDES = ((8, 2), (16, 6))  # pixels between anchors, and anchors at each place
# Key points: right eye, left eye (of the person), nose tip, mouth, right and left tragion.
RIGHT_EYE, LEFT_EYE = 0, 1
SCORE_MIN = 0.5
OVERLAP_MAX = 0.3


@dataclass(frozen=True)
class Detections:
    """Faces found.

    ``boxes`` (m, 3): centre x, y and side, pixels; ``keypoints`` (m, 6, 2) pixels; ``scores`` (m,).
    """

    boxes: np.ndarray
    keypoints: np.ndarray
    scores: np.ndarray

    def __len__(self) -> int:
        return len(self.scores)

    def select(self, keep: np.ndarray) -> Detections:
        """Those that an index or a mask names."""
        return Detections(self.boxes[keep], self.keypoints[keep], self.scores[keep])

    @property
    def roll(self) -> np.ndarray:
        """(m,) radians from the photo's x axis to the line from the person's right eye to the
        left.
        """
        across = self.keypoints[:, LEFT_EYE] - self.keypoints[:, RIGHT_EYE]
        return np.arctan2(across[:, 1], across[:, 0])


def concatenate(parts: list[Detections]) -> Detections:
    """All detections of all parts, in order."""
    return Detections(
        np.concatenate([np.zeros((0, 3)), *(part.boxes for part in parts)]),
        np.concatenate([np.zeros((0, 6, 2)), *(part.keypoints for part in parts)]),
        np.concatenate([np.zeros(0), *(part.scores for part in parts)]),
    )


def anchors() -> np.ndarray:
    """(896, 2) centres of the network's anchors in 0..1, in the order of its outputs."""
    result = []
    for stride, count in STRIDES:
        centre = (np.arange(SIZE // stride) + 0.5) * stride / SIZE
        x, y = np.meshgrid(centre, centre)
        result.append(np.repeat(np.stack([x.ravel(), y.ravel()], axis=1), count, axis=0))
    return np.concatenate(result)


class FaceDetector:
    """Runs the network on squares of a photo."""

    def __init__(self, tflite: bytes) -> None:
        cv2 = opencv()
        self._net = cv2.dnn.readNetFromTFLite(np.frombuffer(tflite, np.uint8))
        self._anchors = anchors()

    def detect(self, views: PhotoViews, crop: Crop) -> Detections:
        """The faces in a square of the photo, with overlaps, in pixels of the photo."""
        image = views.sample(crop, SIZE, repeat_border=False)
        self._net.setInput(np.ascontiguousarray(image.transpose(2, 0, 1)[None] * 2 - 1))
        logits, raw = self._net.forward(["classificators", "regressors"])
        scores = 1.0 / (1.0 + np.exp(-np.clip(logits.ravel(), -80, 80).astype(np.float64)))
        keep = scores > SCORE_MIN
        raw = raw.reshape(-1, 8, 2)[keep].astype(np.float64) / SIZE
        center = raw[:, 0] + self._anchors[keep]
        keypoints = raw[:, 2:] + self._anchors[keep, None]
        side = raw[:, 1].mean(axis=1) * crop.side
        boxes = np.column_stack([crop.to_photo(center), side])
        return Detections(boxes, crop.to_photo(keypoints), scores[keep])


def overlap(box: np.ndarray, boxes: np.ndarray) -> np.ndarray:
    """(m,) intersection over union of a square (centre x, y, side) with squares (m, 3)."""
    reach = (box[2] + boxes[:, 2]) / 2
    extent = reach[:, None] - np.abs(boxes[:, :2] - box[:2])
    shared = np.clip(np.minimum(extent, np.minimum(box[2], boxes[:, 2])[:, None]), 0.0, None).prod(
        axis=1
    )
    union = box[2] ** 2 + boxes[:, 2] ** 2 - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0)


def merge_overlapping(found: Detections) -> Detections:
    """One detection per face: the mean, by score, of those that overlap the best one ("blending" of
    BlazeFace).
    """
    rest = found.select(np.argsort(-found.scores, kind="stable"))
    merged = []
    while len(rest):
        same = overlap(rest.boxes[0], rest.boxes) > OVERLAP_MAX
        same[0] = True
        weights = rest.scores[same] / rest.scores[same].sum()
        merged.append(
            Detections(
                np.einsum("m,mi->i", weights, rest.boxes[same])[None],
                np.einsum("m,mki->ki", weights, rest.keypoints[same])[None],
                rest.scores[:1],
            )
        )
        rest = rest.select(~same)
    return concatenate(merged)
