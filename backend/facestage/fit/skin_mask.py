"""Which pixels show skin: a color model of the face's own skin, from inside its landmarks."""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks

# Added before taking ratios, as a share of the face's mean radiance: black has no hue.
DARK_SHARE = 0.1
# Least spread of log chromaticity on a face (light of two colors, cheeks against forehead) and the
# distances at which a pixel counts in full and no longer.
SPREAD_MIN, FULL, NONE = 0.12, 3.0, 6.0
# Convex hull of brows, nose and chin in each scheme; eyes and mouth are handled by the mesh.
SAMPLE_POINTS = {"ibug68": list(range(2, 15)) + list(range(27, 36))}


def skin_weight(photo: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """(h, w) float32 in 0..1 of ``photo`` (h, w, 3) linear: 1 where its chromaticity is the face's own.

    Brightness is not looked at, so that shadows and highlights stay; hair, cloth and background of
    another hue go. Robust: median and quartile spread, so a beard or glasses do not define the skin.
    """
    inside = _hull_pixels(photo.shape[:2], landmarks)
    if inside.sum() < 20:
        return np.ones(photo.shape[:2], np.float32)
    dark = max(DARK_SHARE * float(photo[inside].mean()), 1e-6)
    logs = np.log(np.maximum(photo, 0) + dark)
    chroma = np.stack([logs[..., 0] - logs[..., 1], logs[..., 2] - logs[..., 1]], axis=-1)
    samples = chroma[inside]
    centre = np.median(samples, axis=0)
    quartiles = np.percentile(samples, [25, 75], axis=0)
    spread = np.maximum(0.741 * (quartiles[1] - quartiles[0]), SPREAD_MIN)
    distance = np.sqrt((((chroma - centre) / spread) ** 2).sum(-1))
    return np.clip((NONE - distance) / (NONE - FULL), 0, 1).astype(np.float32)


def _hull_pixels(shape: tuple[int, int], landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, inside the convex hull of the scheme's sample points."""
    from skimage.morphology import convex_hull_image

    index = SAMPLE_POINTS.get(landmarks.scheme, list(range(len(landmarks.points))))
    points = landmarks.points[index][np.isfinite(landmarks.points[index]).all(1)]
    column, row = np.round(points - 0.5).astype(int).T
    seeds = np.zeros(shape, bool)
    seeds[np.clip(row, 0, shape[0] - 1), np.clip(column, 0, shape[1] - 1)] = True
    if min(np.ptp(row), np.ptp(column)) < 2:
        return seeds
    return convex_hull_image(seeds)
