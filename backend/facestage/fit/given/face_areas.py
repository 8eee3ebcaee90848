"""Where the parts of a face lie in a photo, by its landmarks alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.images.opencv import opencv
from facestage.models.anatomy.landmark_schemes import scheme_of

# Points of the outline that must show for its bounding box to say how large the face is.
OUTLINE_MIN = 12
# Parts of a pixel that the border of an opening is drawn to, in powers of two.
BORDER_BITS = 4
# Half the height of a brow, as a share of the face.
BROW_SHARE = 0.04
# How far the forehead goes on beyond the brows at most, as a share of the way from the chin.
FOREHEAD_SHARE = 0.5
# How near to the lips a beard comes, in shares of the face.
AROUND_MOUTH = 0.1


def opening_share(shape: tuple[int, int], landmarks: Landmarks) -> np.ndarray:
    """(h, w) float32 in 0..1, how much of a pixel shows what lies between the lips or between the
    lids.
    """
    result = np.zeros(shape, np.float32)
    for ring in scheme_of(landmarks.scheme).openings:
        result = np.maximum(result, _share_within(shape, landmarks.points[ring]))
    return result


def mouth_share(shape: tuple[int, int], landmarks: Landmarks) -> np.ndarray:
    """(h, w) float32 in 0..1, how much of a pixel shows what lies between the lips."""
    return _share_within(shape, landmarks.points[scheme_of(landmarks.scheme).openings[0]])


def lips_share(shape: tuple[int, int], landmarks: Landmarks) -> np.ndarray:
    """(h, w) float32 in 0..1, how much of a pixel shows lips."""
    outer = _share_within(shape, landmarks.points[scheme_of(landmarks.scheme).lips])
    return np.asarray(outer * (1.0 - mouth_share(shape, landmarks)))


def around_mouth(shape: tuple[int, int], landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, the lips and as far around them as a beard comes, wherever else it grows."""
    cv2 = opencv()
    beyond = lips_share(shape, landmarks) + mouth_share(shape, landmarks) < 0.5
    away = cv2.distanceTransform(beyond.astype(np.uint8), cv2.DIST_L2, 5)
    return np.asarray(away < AROUND_MOUTH * face_size_px(landmarks))


def _share_within(shape: tuple[int, int], border: np.ndarray) -> np.ndarray:
    """(h, w) float32 in 0..1, how much of a pixel lies within a ``border`` (k, 2) of points; 0
    where one of them is unknown.
    """
    cv2 = opencv()
    filled = np.zeros(shape, np.uint8)
    if np.isfinite(border).all():
        # Pixel centres are at halves in the points, at whole numbers in OpenCV.
        fixed = np.round((border - 0.5) * 2**BORDER_BITS).astype(np.int32)
        cv2.fillPoly(filled, [fixed], 255, cv2.LINE_AA, BORDER_BITS)
    return np.asarray(filled / np.float32(255))


def with_forehead(landmarks: Landmarks, share: float = FOREHEAD_SHARE) -> np.ndarray:
    """(k, 2) pixels: the face's outline, and the brows once more, raised by ``share`` of the way up
    to them from the chin.
    """
    scheme, points = scheme_of(landmarks.scheme), landmarks.points
    raised = points[scheme.brows] + share * chin_to_brows(landmarks)
    return np.concatenate([points[scheme.outline], raised])


def brow_pixels(shape: tuple[int, int], landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, where a brow may be: around the landmarks along its middle."""
    result = np.zeros(shape, bool)
    for brow in brow_lines(landmarks):
        result |= around_line(shape, brow, landmarks)
    return result


def brow_lines(landmarks: Landmarks) -> list[np.ndarray]:
    """Of each brow that has them, the landmarks along its middle (k, 2)."""
    brows = np.split(landmarks.points[scheme_of(landmarks.scheme).brows], 2)
    return [brow for brow in brows if np.isfinite(brow).all()]


def around_line(shape: tuple[int, int], line: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, as far around a ``line`` (k, 2) as a brow is high."""
    cv2 = opencv()
    result = np.zeros(shape, np.uint8)
    drawn = np.round(line - 0.5).astype(np.int32)
    cv2.polylines(result, [drawn], False, 1, 2 * brow_reach(landmarks) + 1)
    return result > 0


def brow_reach(landmarks: Landmarks) -> int:
    """Half the height of a brow, pixels."""
    return max(round(BROW_SHARE * face_size_px(landmarks)), 1)


def face_pixels(shape: tuple[int, int], landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, the face from chin to brows: the convex hull of the scheme's outline."""
    return hull_pixels(shape, landmarks.points[scheme_of(landmarks.scheme).outline])


def below_mouth(shape: tuple[int, int], landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, from the mouth down to the chin, as far to the sides as both are wide."""
    scheme = scheme_of(landmarks.scheme)
    return hull_pixels(shape, landmarks.points[np.concatenate([scheme.lips, scheme.chin])])


def chin_to_brows(landmarks: Landmarks) -> np.ndarray:
    """(2,) pixels, the way up the face from the middle of its chin to that of its brows; NaN where
    one of them is unknown.
    """
    scheme, points = scheme_of(landmarks.scheme), landmarks.points
    brows, chin = points[scheme.brows], points[scheme.chin]
    if np.isnan(brows).all() or np.isnan(chin).all():
        return np.full(2, np.nan)
    return np.asarray(np.nanmean(brows, axis=0) - np.nanmean(chin, axis=0))


def above_brows(shape: tuple[int, int], landmarks: Landmarks) -> np.ndarray:
    """(h, w) how far up the face from the middle of its brows, in ways from chin to brows; NaN
    where one of them is unknown.
    """
    brows = landmarks.points[scheme_of(landmarks.scheme).brows]
    up = chin_to_brows(landmarks)
    if not np.isfinite(up).all():
        return np.full(shape, np.nan)
    middle, direction = np.nanmean(brows, axis=0), up / (up @ up)
    rows, columns = np.arange(shape[0]) + 0.5, np.arange(shape[1]) + 0.5
    return ((rows - middle[1]) * direction[1])[:, None] + (columns - middle[0]) * direction[0]


def face_size_px(landmarks: Landmarks) -> float:
    """Longer side in pixels of the bounding box of the face from chin to brows, as far as it shows;
    0 for no face.

    It means the same in every scheme. Where none of the outline counts, all counted points stand in
    for it.
    """
    outline = np.zeros(len(landmarks.points), bool)
    outline[scheme_of(landmarks.scheme).outline] = True
    chosen = landmarks.counted & outline
    points = landmarks.points[chosen if chosen.sum() >= OUTLINE_MIN else landmarks.counted]
    return float(np.ptp(points, axis=0).max())


def no_larger(
    landmarks: Landmarks, shape: tuple[int, int], face_px: float
) -> tuple[tuple[int, int], Landmarks]:
    """Width and height that a photo (h, w) has where its face is no larger than ``face_px``, and
    the landmarks there.
    """
    height, width = shape
    scale = min(face_px / max(face_size_px(landmarks), 1.0), 1.0)
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    points = landmarks.points * np.array(size) / [width, height]
    return size, replace(landmarks, points=points)


def hull_pixels(shape: tuple[int, int], chosen: np.ndarray) -> np.ndarray:
    """(h, w) bool, inside the convex hull of those points ``chosen`` (k, 2) that are known."""
    from skimage.morphology import convex_hull_image

    chosen = chosen[np.isfinite(chosen).all(1)]
    seeds = np.zeros(shape, bool)
    if not len(chosen):
        return seeds
    column, row = np.round(chosen - 0.5).astype(int).T
    seeds[np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)] = True
    if min(np.ptp(row), np.ptp(column)) < 2:
        return seeds
    return convex_hull_image(seeds)
