"""Eyelids as concentric loops that hug the eyeball, and the eyeballs with iris and pupil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.models.head.base_surface import BaseSurface
from facestage.models.head.features import EYE_CENTER, EYE_RADIUS, add_features, smooth_maximum

INNER_CORNER = np.array([17.0, -2.2])
OUTER_CORNER = np.array([45.7, -0.6])
LID_THICKNESS = 1.2
LID_LOOPS = (0.2, 0.38, 0.54, 0.68, 0.79, 0.87)  # between the window (0) and the lid margin (1)
MARGIN = len(LID_LOOPS) + 1  # the loop of the lids' margins; two more lie behind it

IRIS_RADIUS, PUPIL_RADIUS = 5.9, 2.0
_POLAR_DEGREES = (
    3.2,
    6.4,
    9.2,
    10.2,
    13,
    17,
    21,
    25,
    27.4,
    28.6,
    30.5,
    34,
    40,
    48,
    58,
    70,
    85,
    100,
    120,
    145,
)
EYE_SEGMENTS = 28


@dataclass(frozen=True)
class Patch:
    """Loops that fill a window: positions (rings, n, 3) mm and chart points (rings, n, 2),
    outermost first.
    """

    positions: np.ndarray
    chart: np.ndarray


def lid_curve(count: int) -> np.ndarray:
    """(count, 2) front view of the left lid margin, counterclockwise from the inner corner along
    the lower lid.
    """
    half = count // 2
    along = np.arange(half + 1) / half
    along = 0.6 * along + 0.4 * (0.5 - 0.5 * np.cos(np.pi * along))
    chord = INNER_CORNER + along[:, None] * (OUTER_CORNER - INNER_CORNER)
    lower = chord - np.stack(
        [np.zeros(half + 1), 3.6 * np.sin(np.pi * along**0.95) ** 1.02], axis=-1
    )
    upper = chord + np.stack(
        [np.zeros(half + 1), 6.5 * np.sin(np.pi * along**0.88) ** 1.25], axis=-1
    )
    return np.concatenate([lower[:-1], upper[:0:-1]])


def lid_patch(surface: BaseSurface, window_chart: np.ndarray) -> Patch:
    """Loops of the left eye inside its window border (n, 2): lid surface, lid margin, and the tuck
    behind the lid.
    """
    n = len(window_chart)
    margin_xy = lid_curve(n)
    margin_chart = surface.chart_at(margin_xy)
    upper = np.zeros(n)
    upper[n // 2 + 1 :] = np.sin(np.pi * np.arange(1, n - n // 2) / (n // 2))
    steps = np.minimum(np.arange(n), np.abs(np.arange(n) - n // 2))
    corner = np.exp(-((np.minimum(steps, n - np.arange(n)) / 2.2) ** 2))
    positions, charts = [], []
    for t in (*LID_LOOPS, 1.0):
        # Loops keep clear of the corners, where the margin turns sharply.
        share = (t - 0.2 * t * (1 - t) * corner)[:, None] * np.ones(2)
        # At the corners they are level with the margin, not strung out along the line of one lid.
        share[:, 1] += corner * (1 - (1 - t) ** 1.8 - share[:, 1])
        chart = window_chart + share * (margin_chart - window_chart)
        point = add_features(surface.point(*chart.T))
        # The fold of the upper lid: a shallow furrow parallel to the margin.
        fold = np.exp(-(((t - 0.68) / 0.1) ** 2)) * upper
        point = _over_eyeball(point, LID_THICKNESS + 0.5 * (1 - t))
        relative = point - EYE_CENTER
        point = point - 1.5 * fold[:, None] * relative / np.linalg.norm(
            relative, axis=1, keepdims=True
        )
        positions.append(point)
        charts.append(chart)
    # In the chart the loops behind the margin draw together towards the line between the corners.
    chord = margin_chart[n // 2] - margin_chart[0]
    center = margin_chart[0] + 0.5 * chord
    along = ((margin_chart - center) @ chord)[:, None] * chord / (chord @ chord)
    for shrink, radius, spread in ((0.25, 0.2, -0.35), (0.5, -1.5, 2.0)):
        positions.append(_behind_margin(positions[len(LID_LOOPS)], radius, spread))
        charts.append(
            center + 0.84**shrink * along + (1 - shrink) * (margin_chart - center - along)
        )
    return Patch(np.stack(positions), np.stack(charts))


def _over_eyeball(points: np.ndarray, thickness: float) -> np.ndarray:
    """Points kept at least `thickness` mm outside the eyeball."""
    relative = points - EYE_CENTER
    radius = np.linalg.norm(relative, axis=1)
    lifted = smooth_maximum(radius, np.full_like(radius, EYE_RADIUS + thickness - 0.3), 1.2)
    return EYE_CENTER + relative * (lifted / radius)[:, None]


def _behind_margin(margin: np.ndarray, offset: float, spread: float) -> np.ndarray:
    """The margin moved to a radius `offset` mm from the eyeball's and `spread` mm away from the
    opening.
    """
    opposite = margin[(len(margin) - np.arange(len(margin))) % len(margin)]
    away = np.array([[0.0, 1.0, 0.0]]) * np.sign(margin[:, 1:2] - opposite[:, 1:2])
    gap = np.abs(margin[:, 1:2] - opposite[:, 1:2])
    moved = margin + away * np.where(
        spread < 0, np.maximum(spread, -0.2 * gap), spread * np.minimum(gap / 4, 1)
    )
    relative = moved - EYE_CENTER
    radius = np.linalg.norm(relative, axis=1, keepdims=True)
    excess = np.maximum(
        np.linalg.norm(margin - EYE_CENTER, axis=1, keepdims=True) - EYE_RADIUS - LID_THICKNESS, 0.0
    )
    return EYE_CENTER + relative / radius * (EYE_RADIUS + offset + 0.45 * excess)


def mirrored(patch: Patch) -> Patch:
    """The same loops on the subject's right, in the order of the right window's border."""
    n = patch.positions.shape[1]
    order = (n // 2 - np.arange(n)) % n
    return Patch(patch.positions[:, order] * [-1, 1, 1], patch.chart[:, order] * [-1, 1])


def eyeball() -> tuple[np.ndarray, np.ndarray]:
    """(rings, segments, 3) mm relative to the eye's centre, from the pupil backwards, and its polar
    angles (rings,).
    """
    polar = np.radians(_POLAR_DEGREES)
    angle = 2 * np.pi * np.arange(EYE_SEGMENTS) / EYE_SEGMENTS
    ring = np.stack([np.cos(angle), np.sin(angle), np.zeros(EYE_SEGMENTS)], axis=-1)
    points = np.sin(polar)[:, None, None] * ring + np.cos(polar)[:, None, None] * np.array(
        [0.0, 0.0, 1.0]
    )
    return EYE_RADIUS * points, polar
