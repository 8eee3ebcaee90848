"""The ear as concentric loops: round the back to the helix, over its rim, and into the concha."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from facestage.models.head.base_surface import BaseSurface
from facestage.models.head.eyes import Patch

# Outline in the plane of the ear (backward, up) in mm from the ear canal, counterclockwise seen
# from outside, starting at the tragus; height about 63 mm and breadth about 36 mm (Farkas 1994).
_OUTLINE = np.array([
    (-4.5, -4), (-4.8, -13), (-3.8, -22), (0, -29), (7.5, -31), (14, -26), (19.5, -13), (25, 2),
    (27.5, 16), (24, 27),
    (15.5, 32.5), (6, 31), (-0.5, 24), (-3.5, 14), (-4.3, 4),
])  # fmt: skip
# How free of the head the ear is at each outline point: 0 in front, 1 behind; and how strongly the
# helix curls.
_FREE = np.array([0, 0, 0.25, 0.8, 1, 1, 1, 1, 1, 1, 1, 0.9, 0.5, 0.1, 0], float)
_CURL = np.array([0, 0, 0, 0, 0.1, 0.4, 0.8, 1, 1, 1, 1, 1, 0.9, 0.6, 0.15], float)
_TRAGUS = np.array([1, 0.6, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.4], float)
_CENTER = np.array([4.5, -5.0])
# Loops from the back edge inward: scale about the centre, height of the curled and of the flat
# outline.
_LOOPS = (
    (0.965, -2.2, -1.2), (1.0, -0.5, 0.0), (0.985, 1.6, 1.0), (0.92, 2.2, 1.3), (0.85, 1.0, 1.3),
    (0.78, -1.6, 1.2),
    (0.69, -1.0, 1.2), (0.61, 1.4, 1.2), (0.53, 1.2, 0.6), (0.44, -2.5, -2.0),
    (0.34, -6.0, -5.5), (0.2, -7.0, -7.0),
)  # fmt: skip
_PROTRUSION_DEGREES = 21.0
_TILT_DEGREES = 12.0


def ear_patch(surface: BaseSurface, window_chart: np.ndarray) -> Patch:
    """Loops of the left ear inside its window border (n, 2); the last loop is to be capped."""
    knots = np.linspace(0, 1, len(_OUTLINE) + 1)
    low, high = window_chart.min(axis=0), window_chart.max(axis=0)
    relative = (window_chart - 0.5 * (low + high)) / (high - low)
    angle = np.unwrap(np.arctan2(relative[:, 1], relative[:, 0]))
    angle += 2 * np.pi * np.round((np.pi - angle[0]) / (2 * np.pi))
    fine = np.linspace(0, 1, 2001)
    fine_outline = CubicSpline(knots, np.concatenate([_OUTLINE, _OUTLINE[:1]]), bc_type="periodic")(
        fine
    )
    # Loops run straight out from the ear: the same direction on the window, the seam and the
    # outline.
    around = np.arctan2(fine_outline[:-1, 1] / 31.0, (fine_outline[:-1, 0] - 10.0) / 15.0)
    # ... but the window has few vertices above and below, where the outline needs them: meet
    # half-way.
    even = np.pi + 2 * np.pi * np.arange(len(angle)) / len(angle)
    phase = np.interp(0.25 * angle + 0.75 * even, around, fine[:-1], period=2 * np.pi)
    angle = 0.6 * angle + 0.4 * even

    def along(values: np.ndarray) -> np.ndarray:
        return CubicSpline(knots, np.concatenate([values, values[:1]]), bc_type="periodic")(phase)

    outline = along(_OUTLINE)
    free, curl, tragus = (np.clip(along(values), 0, 1) for values in (_FREE, _CURL, _TRAGUS))
    attached = np.stack(
        [7.36 + 0.29 * np.cos(angle), 0.5 * (low + high)[1] + 3.0 * np.sin(angle)], axis=-1
    )
    seam = surface.point(*attached.T)
    origin, back, up, out = _frame(surface)

    def in_plane(plane: np.ndarray, height: np.ndarray) -> np.ndarray:
        return origin + plane[:, :1] * back + plane[:, 1:] * up + height[:, None] * out

    positions, charts = [seam], [attached]
    edge = in_plane(_CENTER + _LOOPS[0][0] * (outline - _CENTER), _LOOPS[0][1] * free)
    # The back of the ear leaves the head steeply, then turns outward.
    neck = seam + 0.45 * (edge - seam)
    positions.append(neck)
    charts.append(attached)
    for scale, curled, flat in _LOOPS:
        plane = _CENTER + scale * (outline - _CENTER)
        height = curl * curled + (1 - curl) * flat
        height = height + tragus * 2.2 * np.exp(-(((scale - 0.72) / 0.16) ** 2))
        point = in_plane(plane, height)
        # In front there is no rim: the loops run from the face straight to the tragus.
        attach = (1 - free) * np.clip((scale - 0.75) / 0.25, 0, 1)
        positions.append(point + attach[:, None] * 0.8 * (seam - point))
        charts.append(attached)
    center = attached.mean(axis=0)
    shrink = np.linspace(1, 0.12, len(charts))[:, None, None]
    chart = center + shrink * (np.stack(charts) - center)
    return Patch(np.stack(positions), chart)


def _frame(surface: BaseSurface) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Origin (mm) and the backward, upward and outward axes of the plane of the left ear."""
    origin = surface.point(np.array([7.25]), np.array([9.4]))[0] + [1.0, 0.0, 0.0]
    protrusion, tilt = np.radians(_PROTRUSION_DEGREES), np.radians(_TILT_DEGREES)
    level_back = np.array([np.sin(protrusion), 0.0, -np.cos(protrusion)])
    upright = np.array([0.08, 1.0, 0.0])
    upright -= level_back * (upright @ level_back)
    upright /= np.linalg.norm(upright)
    back = np.cos(tilt) * level_back - np.sin(tilt) * upright
    up = np.cos(tilt) * upright + np.sin(tilt) * level_back
    return origin, back, up, np.cross(back, up)
