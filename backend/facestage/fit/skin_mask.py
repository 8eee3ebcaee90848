"""Which pixels show skin: a color model of the face's own skin, from inside its landmarks."""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.models.landmark_schemes import scheme_of

# Added before taking ratios, as a share of the face's mean radiance: black has no hue.
DARK_SHARE = 0.1
# Least spread of (log red/green, log blue/green, log luminance) on a face: light of two colors, cheeks
# against forehead, shading. A face half in shadow widens its own luminance spread.
SPREAD_MIN = (0.12, 0.12, 0.28)
# Distances, in spreads, at which a pixel counts in full and no longer.
FULL, NONE = 2.0, 3.5
# Points of the outline that must show for its bounding box to say how large the face is.
OUTLINE_MIN = 12


def skin_weight(photo: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """(h, w) float32 in 0..1 of ``photo`` (h, w, 3) linear: 1 where its color is the face's own.

    Hair, cloth and background of another hue, or darker than the face's own shading, go; what is brighter
    stays, because highlights are skin. Robust: median and quartiles, so glasses do not define the skin.
    """
    # A hull of cheeks and chin, without brows and forehead. Eyes and mouth are the mesh's matter.
    inside = _hull_pixels((photo.shape[0], photo.shape[1]), landmarks.points[scheme_of(landmarks.scheme).skin])
    if inside.sum() < 20:
        return np.ones(photo.shape[:2], np.float32)
    dark = max(DARK_SHARE * float(photo[inside].mean()), 1e-6)
    logs = np.log(np.maximum(photo, 0) + dark)
    features = np.stack([logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1], logs.mean(-1)], axis=-1)
    samples = features[inside]
    centre = np.median(samples, axis=0)
    quartiles = np.percentile(samples, [25, 75], axis=0)
    spread = np.maximum(0.741 * (quartiles[1] - quartiles[0]), SPREAD_MIN)
    offset = (features - centre) / spread
    offset[..., 2] = np.minimum(offset[..., 2], 0.0)
    distance = np.sqrt((offset**2).sum(-1))
    return np.clip((NONE - distance) / (NONE - FULL), 0, 1).astype(np.float32)


def face_pixels(shape: tuple[int, int], landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, the face from chin to brows: the convex hull of the scheme's outline."""
    return _hull_pixels(shape, landmarks.points[scheme_of(landmarks.scheme).outline])


def face_size_px(landmarks: Landmarks) -> float:
    """Longer side in pixels of the bounding box of the face from chin to brows, as far as it shows; 0 for no face.

    It means the same in every scheme. Where none of the outline counts, all counted points stand in for it.
    """
    outline = np.zeros(len(landmarks.points), bool)
    outline[scheme_of(landmarks.scheme).outline] = True
    chosen = landmarks.counted & outline
    points = landmarks.points[chosen if chosen.sum() >= OUTLINE_MIN else landmarks.counted]
    return float(np.ptp(points, axis=0).max())


def _hull_pixels(shape: tuple[int, int], chosen: np.ndarray) -> np.ndarray:
    """(h, w) bool, inside the convex hull of points ``chosen`` (k, 2)."""
    from skimage.morphology import convex_hull_image

    chosen = chosen[np.isfinite(chosen).all(1)]
    column, row = np.round(chosen - 0.5).astype(int).T
    seeds = np.zeros(shape, bool)
    seeds[np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)] = True
    if min(np.ptp(row), np.ptp(column)) < 2:
        return seeds
    return convex_hull_image(seeds)
