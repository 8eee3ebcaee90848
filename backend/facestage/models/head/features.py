"""Local relief on the smooth base: nose wings and nostrils, philtrum, folds, cheekbones, neck.

Positions are mm in the frame of the control net. Every feature is mirrored: it is written for the
subject's left.
"""

from __future__ import annotations

import numpy as np

EYE_CENTER = np.array([31.4, -0.3, 67.2])
EYE_RADIUS = 12.2
# Centre line of the hair of the brow, from its inner to its outer end: front view (|x|, y). Level
# with a slight arch, highest over the outer third.
BROW_LINE = ((12.0, 20.0), (24.0, 22.6), (36.0, 24.0), (46.5, 22.4), (55.5, 17.8))

# Reliefs: centre |x|, y; Gaussian radii; displacement (outward x, y, z).
_BUMPS = (
    ((17.2, -40.0), (3.0, 3.4), (-1.0, 0.0, -1.8)),  # crease above the nose wing
    ((20.2, -48.5), (2.2, 4.5), (0.0, 0.0, -1.3)),  # crease beside the nose wing
    ((9.0, -36.5), (4.0, 3.4), (-0.5, 0.0, -1.3)),  # between tip and wing
    ((0.0, -42.0), (6.0, 5.5), (0.0, -0.9, 1.4)),  # tip
    ((0.0, -46.0), (4.0, 4.0), (0.0, -1.0, 0.6)),  # columella
    ((15.0, -51.0), (4.0, 3.4), (-0.5, 1.2, 0.0)),  # the wing is round below
    ((0.0, -58.5), (2.4, 4.5), (0.0, 0.0, -1.1)),  # philtrum
    ((4.6, -60.0), (1.8, 4.5), (0.0, 0.0, 0.7)),  # philtral column
    ((23.0, -15.5), (8.0, 4.0), (0.0, 0.0, -1.2)),  # tear trough
    ((45.0, -22.0), (13.0, 9.0), (0.8, 0.0, 1.8)),  # cheekbone
    ((37.0, -52.0), (10.0, 13.0), (0.4, 0.0, 1.0)),  # fullness of the cheek
    ((29.0, -74.0), (5.5, 5.5), (0.0, 0.0, -1.4)),  # corner of the mouth
    ((0.0, -106.0), (11.0, 8.0), (0.0, 0.0, 1.2)),  # chin
    ((29.0, 17.5), (17.0, 6.5), (0.0, 0.0, 1.4)),  # brow ridge
    ((0.0, 9.0), (8.0, 8.0), (0.0, 0.0, -0.6)),  # nasal root
    ((0.0, -150.0), (9.0, 10.0), (0.0, 0.0, 2.4)),  # larynx
)
# Furrows: two ends (|x|, y), width, displacement.
_FURROWS = (
    ((21.0, -46.0), (31.5, -68.0), 4.0, (0.0, 0.0, -1.3)),  # nasolabial fold
    ((27.0, -41.0), (39.0, -64.0), 6.0, (0.3, 0.0, 0.8)),  # cheek beside it
)


def add_features(points: np.ndarray) -> np.ndarray:
    """Base points (m, 3) with the relief added, (m, 3)."""
    points = np.asarray(points, np.float64)
    side = np.where(points[:, 0] < 0, -1.0, 1.0)
    local = points * np.stack([side, np.ones_like(side), np.ones_like(side)], axis=-1)
    front = smoothstep((local[:, 2] - 20.0) / 20.0)
    result = inflate(local, np.array([11.4, -46.3, 93.5]), np.array([6.6, 6.6, 11.0]), 0.5)
    for center, radius, move in _BUMPS:
        weight = np.exp(
            -(((local[:, 0] - center[0]) / radius[0]) ** 2)
            - ((local[:, 1] - center[1]) / radius[1]) ** 2
        )
        result = result + (front * weight)[:, None] * _faded(np.array(move), local[:, 0])
    for start, end, width, move in _FURROWS:
        distance, along = to_segment(local[:, :2], np.array(start), np.array(end))
        weight = np.exp(-((distance / width) ** 2)) * np.sin(np.pi * (0.08 + 0.84 * along))
        result = result + (front * weight)[:, None] * np.array(move)
    nostril = np.exp(-((((local - [6.6, -50.0, 104.0]) / [3.3, 4.0, 5.2]) ** 2).sum(axis=1)))
    result = result + nostril[:, None] * np.array([0.0, 5.8, -1.0])
    result = _neck_muscle(result)
    return result * np.stack([side, np.ones_like(side), np.ones_like(side)], axis=-1)


def inflate(
    points: np.ndarray, center: np.ndarray, radii: np.ndarray, softness: float
) -> np.ndarray:
    """Points (m, 3) pushed out of an ellipsoid along its radii; softness is the blend width in
    radii.
    """
    relative = (points - center) / radii
    radius = np.maximum(np.linalg.norm(relative, axis=1), 1e-9)
    outside = smooth_maximum(radius, np.ones_like(radius), softness)
    return center + relative * (outside / radius)[:, None] * radii


def smooth_maximum(a: np.ndarray, b: np.ndarray, softness: float | np.ndarray) -> np.ndarray:
    """The larger of two arrays with the corner rounded over +-softness; exact outside of that."""
    overlap = np.maximum(softness - np.abs(a - b), 0.0) / np.maximum(softness, 1e-12)
    return np.maximum(a, b) + overlap**2 * softness * 0.25


def _neck_muscle(local: np.ndarray) -> np.ndarray:
    """The sternocleidomastoid, from behind the ear to the inner end of the collar bone."""
    distance, along = to_segment(
        local, np.array([60.0, -60.0, -22.0]), np.array([16.0, -196.0, 34.0])
    )
    weight = (
        np.exp(-((distance / 11.0) ** 2)) * np.sin(np.pi * np.clip(0.1 + 0.85 * along, 0, 1)) ** 0.8
    )
    axis = np.stack([local[:, 0], np.zeros(len(local)), local[:, 2] + 20.0], axis=-1)
    axis /= np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), 1e-9)
    return local + 2.2 * weight[:, None] * axis


def _faded(move: np.ndarray, x: np.ndarray) -> np.ndarray:
    """(m, 3) a move whose outward part vanishes on the midline, so that it does not tear the two
    halves apart.
    """
    return np.stack(
        [move[0] * np.tanh(x / 3.0), np.full(len(x), move[1]), np.full(len(x), move[2])], axis=-1
    )


def to_segment(
    points: np.ndarray, start: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distance of points (m, d) to a segment, and the parameter 0..1 of the nearest point."""
    axis = end - start
    along = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
    return np.linalg.norm(points - start - along[:, None] * axis, axis=1), along


def smoothstep(x: np.ndarray) -> np.ndarray:
    """0 below 0, 1 above 1, and a cubic between."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)
