"""A face from the front, flat, with brows, eyes and whatever is worn on it."""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.models.anatomy.landmark_schemes import scheme_of

SIZES = {"mediapipe478": 478, "ibug68": 68}
SIDE = 360
SKIN, DARK = np.array([0.5, 0.32, 0.25]), np.array([0.03, 0.03, 0.03])
Y, X = np.mgrid[:SIDE, :SIDE] + 0.5
# The face reaches from the brows' row to the chin's; an eye is 56 wide and 16 high.
MIDDLE, BROWS, EYES, CHIN = 180.0, 90.0, 130.0, 330.0
APART, EYE_WIDTH, EYE_HEIGHT, LENS = 45.0, 56.0, 16.0, 40.0
RING = np.abs(np.hypot(np.abs(X - MIDDLE) - APART, Y - EYES) - LENS) < 4
BRIDGE = (np.abs(X - MIDDLE) < APART - LENS + 4) & (np.abs(Y - EYES + 3) < 4)
BROW = (np.abs(np.abs(X - MIDDLE) - APART) < 40) & (np.abs(Y - BROWS) < 7)
FRAME = (RING | BRIDGE) & (Y > BROWS + 12)


def landmarks(scheme: str) -> Landmarks:
    """Eyes, brows and chin of a face seen from the front, all other points at its middle."""
    parts = scheme_of(scheme)
    points = np.full((SIZES[scheme], 2), [MIDDLE, 220.0])
    for ring, x in zip(parts.openings[1:], (MIDDLE - APART, MIDDLE + APART), strict=True):
        angle = 2 * np.pi * np.arange(len(ring)) / len(ring)
        points[ring] = np.stack(
            [x + EYE_WIDTH / 2 * np.cos(angle), EYES + EYE_HEIGHT / 2 * np.sin(angle)], axis=1
        )
    points[parts.brows] = np.stack(
        [np.linspace(MIDDLE - 85, MIDDLE + 85, len(parts.brows)), np.full(len(parts.brows), BROWS)],
        axis=1,
    )
    points[parts.chin] = np.stack(
        [np.linspace(MIDDLE - 40, MIDDLE + 40, len(parts.chin)), np.full(len(parts.chin), CHIN)],
        axis=1,
    )
    return Landmarks(scheme, points, np.ones(len(points), bool))


def drawn(*dark: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(h, w, 3) skin with dark brows, eyes and whatever else is ``dark``, and its skin (h, w)."""
    eyes = np.hypot((np.abs(X - MIDDLE) - APART) / EYE_WIDTH, (Y - EYES) / EYE_HEIGHT) < 0.5
    black = np.any([BROW, eyes, *dark], axis=0)
    shading = 0.6 + 0.4 * np.sin(X / 60)
    color = np.where(black[..., None], DARK, shading[..., None] * SKIN)
    return color, np.where(black, 0.0, 1.0)
