"""Lips as concentric loops round the mouth line, the bag of the mouth behind them, and the
tongue.
"""

from __future__ import annotations

import numpy as np

from facestage.models.head.base_surface import BaseSurface
from facestage.models.head.eyes import Patch
from facestage.models.head.features import add_features

MOUTH_HALF_WIDTH = 25.2
MOUTH_CORNER_Y = -73.4
OUTER_LOOPS = (0.24, 0.46, 0.66, 0.84)  # between the window (0) and the border of the red lip (1)
# Cross-section of a lip from its border to the line where the lips meet: share of the height,
# forward bulge.
_UPPER_PROFILE = ((0.0, 0.5), (0.12, 1.7), (0.4, 3.0), (0.72, 3.3), (0.92, 2.6), (1.0, 1.4))
_LOWER_PROFILE = ((0.0, 0.0), (0.12, 0.9), (0.4, 3.0), (0.72, 3.6), (0.92, 3.0), (1.0, 1.4))
# The lower lip runs straight on below the bow of the upper one, which hides it: up in the middle,
# half width as a share of the mouth's; and there it stands back: by share of the height.
_STRAIGHT, _STRAIGHT_WIDTH = 0.45, 0.19
_BACK = ((0.0, 0.0), (0.4, 0.0), (0.72, 0.2), (0.92, 0.5), (1.0, 0.5))
# Behind the meeting line: backward, away from the line, sideways.
_INNER = ((3.0, 0.5, 0.0), (5.2, 2.2, 0.3), (6.4, 5.5, 1.0))
_BAG = ((7.0, 13.5, 2.5), (24.0, 17.0, 5.0), (42.0, 13.0, 1.0), (52.0, 6.0, -8.0))
LIP_LOOPS = len(OUTER_LOOPS) + len(_UPPER_PROFILE)  # rows of skin loops up to the meeting line
SKIN_LOOPS = LIP_LOOPS + len(_INNER)


def lip_lines(x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Front view heights (m,) in mm of the upper border, the meeting line and the lower border at x
    (m,).
    """
    s = np.minimum(np.abs(x) / MOUTH_HALF_WIDTH, 1.0)
    upper = MOUTH_CORNER_Y + 9.3 * (1 - s**1.75) - 1.5 * np.exp(-((s / 0.11) ** 2)) * (1 - s)
    middle = (
        MOUTH_CORNER_Y + 0.6 * np.sin(np.pi * s) - 0.25 * np.exp(-((s / 0.2) ** 2)) + 0.3 * (1 - s)
    )
    lower = MOUTH_CORNER_Y - 10.4 * (1 - s**2.4)
    return upper, middle, lower


def lip_patch(surface: BaseSurface, window_chart: np.ndarray) -> tuple[Patch, np.ndarray]:
    """Loops of the lips inside the window border (n, 2), and the loops of the mouth bag (rings, n,
    3) behind them.

    The lips meet; their chart points (for UVs only) leave the meeting line slightly open.
    """
    n = len(window_chart)
    half = n // 2
    along = np.arange(half + 1) / half
    x_half = MOUTH_HALF_WIDTH * (0.15 * (2 * along - 1) - 0.85 * np.cos(np.pi * along))
    x = np.concatenate([x_half[:-1], x_half[:0:-1]])
    is_upper = np.arange(n) > half
    is_corner = (np.arange(n) == 0) | (np.arange(n) == half)
    sign = np.where(is_corner, 0.0, np.where(is_upper, 1.0, -1.0))
    upper_y, middle_y, lower_y = lip_lines(x)
    border_y = np.where(is_upper, upper_y, lower_y)
    border_chart = surface.chart_at(np.stack([x, border_y], axis=-1))
    positions, charts = [], []
    for t in OUTER_LOOPS:
        chart = window_chart + t * (border_chart - window_chart)
        positions.append(add_features(surface.point(*chart.T)))
        charts.append(chart)
    fade = np.sqrt(np.clip(1 - np.abs(x / MOUTH_HALF_WIDTH) ** 3, 0, 1))
    straight = np.exp(-((x / MOUTH_HALF_WIDTH / _STRAIGHT_WIDTH) ** 2)) * (sign < 0)
    middle_y = middle_y + _STRAIGHT * straight
    for (share, bulge_upper), (_, bulge_lower) in zip(_UPPER_PROFILE, _LOWER_PROFILE, strict=True):
        y = border_y + share * (middle_y - border_y)
        # Inner loops are a little shorter: at the corners they follow each other instead of meeting
        # in one point.
        inner_x = x * (1 - 0.03 * share)
        point = add_features(surface.point(*surface.chart_at(np.stack([inner_x, y], axis=-1)).T))
        point[:, 2] += np.where(is_upper, bulge_upper, bulge_lower) * fade - 2.2 * share * (
            1 - fade
        )
        point[:, 2] -= np.interp(share, *np.transpose(_BACK)) * straight
        if share == 1.0:
            point[:, 1] += 0.03 * sign
        positions.append(point)
        charts.append(_shrunk(border_chart, share))
    line = positions[-1]
    opening = sign * np.sqrt(np.clip(1 - (x / (MOUTH_HALF_WIDTH * 1.02)) ** 2, 0.0, 1.0))
    for k, (back, away, out) in enumerate(_INNER):
        positions.append(
            line + np.stack([np.tanh(x / 4.0) * out, away * opening, np.full(n, -back)], axis=-1)
        )
        charts.append(_shrunk(border_chart, 1.1 + 0.1 * k))
    roomy = sign * np.sqrt(np.clip(1 - (x / (MOUTH_HALF_WIDTH * 1.02)) ** 4, 0.0, 1.0))
    bag = [
        line + np.stack([out * x / MOUTH_HALF_WIDTH, away * roomy, np.full(n, -back)], axis=-1)
        for back, away, out in _BAG
    ]
    return Patch(np.stack(positions), np.stack(charts)), np.stack(bag)


def _shrunk(border: np.ndarray, share: float) -> np.ndarray:
    """The border of the lips in the chart, drawn together so that following loops nest; share 1 is
    the meeting line.
    """
    center = np.array([0.0, border[0, 1]])
    return center + (border - center) * [1 - 0.08 * share, 1 - 0.72 * share]


def tongue(rows: int = 9, columns: int = 10) -> np.ndarray:
    """(rows, columns, 3) mm: closed rings round the tongue from its root to its tip.

    Its back lies as high as the teeth meet, the tip behind the lower incisors: from before, an open
    mouth shows it above the lower teeth.
    """
    along = np.linspace(0, 1, rows)
    angle = 2 * np.pi * np.arange(columns) / columns
    half_width = 17.0 * np.sqrt(np.clip(1 - (0.97 * along) ** 3, 0, 1))
    half_height = 6.0 * np.sqrt(np.clip(1 - (0.95 * along) ** 2, 0, 1))
    center_y = -82.5 + 5.0 * np.sin(np.pi * np.clip(0.2 + 0.8 * along, 0, 1))
    center_z = 46.0 + 37.0 * along
    x = half_width[:, None] * np.cos(angle)
    y = center_y[:, None] + half_height[:, None] * np.sin(angle)
    return np.stack([x, y, np.broadcast_to(center_z[:, None], x.shape)], axis=-1)
