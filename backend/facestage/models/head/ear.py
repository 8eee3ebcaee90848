"""The ear as concentric loops: round the back to the helix, over its rim, and into the concha;
plain, from which the modes are read, and with its folds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from facestage.models.head.base_surface import BaseSurface
from facestage.models.head.eyes import Patch
from facestage.models.head.features import to_segment

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
# Round the ear from the tragus: its outline, the rim of the concha on the same ray (both backward,
# up), the height of that rim above the plane of the ear, of the helix and of the groove inside it
# (mm), and how free of the head the ear is. Breadth and length after Farkas 1994.
_FOLDS = np.array([
    (-4.5, -4.0, -1.0, -4.0, 2.8, 0.0, 0.0, 0.0),  # tragus
    (-4.8, -13.0, 0.8, -10.5, -3.0, 0.0, 0.0, 0.0),  # notch between tragus and antitragus
    (-3.8, -22.0, 3.2, -12.8, -0.2, 0.2, 0.4, 0.12),
    (0.0, -29.0, 5.5, -13.8, 2.0, 0.4, 0.6, 0.7),  # antitragus
    (7.2, -31.5, 8.3, -13.4, 2.4, 0.6, 0.4, 1.0),  # lobe
    (15.0, -26.5, 11.3, -11.4, 2.2, 1.4, -0.2, 1.0),
    (21.3, -13.5, 13.6, -7.5, 2.8, 2.6, -1.4, 1.0),  # antihelix
    (26.3, 2.0, 15.2, -0.5, 3.4, 3.3, -2.2, 1.0),
    (28.0, 16.0, 15.4, 6.5, 3.4, 3.7, -2.6, 1.0),
    (24.3, 27.0, 13.8, 11.0, 2.8, 3.9, -2.6, 1.0),
    (15.5, 32.5, 10.3, 13.2, 1.8, 4.0, -2.4, 1.0),  # lower crus
    (6.0, 31.0, 5.5, 13.8, 1.2, 4.0, -2.4, 0.95),
    (-0.5, 24.0, 1.3, 12.2, 0.6, 3.6, -1.8, 0.6),
    (-3.5, 14.0, -1.6, 8.8, 0.2, 2.4, -0.4, 0.15),  # root of the helix
    (-4.3, 4.0, -2.0, 3.0, 0.6, 0.6, 0.0, 0.0),  # notch above the tragus
])  # fmt: skip
# Loops from the back edge over the rim: scale about the centre, share of the helix's height.
_RIM = ((0.965, -0.6), (1.0, 0.0), (0.972, 0.85), (0.915, 0.9))
# ... down into the groove and up the antihelix: place between, share of the groove's height.
_SLOPE = ((0.13, 0.75), (0.45, 1.0), (0.78, 0.35), (1.0, 0.0))
# ... and into the concha: scale about the canal, share of the rim's height, depth below.
_BOWL = ((0.9, 0.45, -3.5), (0.74, 0.0, -7.5), (0.48, 0.0, -9.0), (0.22, 0.0, -12.0))
_CANAL = np.array([1.5, -2.5])
# In front, where the ear is no rim, the loops run from the cheek to the tragus.
_FROM_CHEEK = (0.15, 0.28, 0.4, 0.52, 0.64, 0.76, 0.9, 1.0)
# Ridges: two ends in the plane, width, height: the upper crus of the antihelix; the root of the
# helix across the concha.
_UPPER_CRUS = (np.array([14.5, 9.0]), np.array([11.5, 24.0]), 3.6, 3.2)
_HELIX_ROOT = (np.array([-3.0, 8.5]), np.array([6.5, 2.0]), 2.8, 4.5)
_PROTRUSION_DEGREES = 21.0
_TILT_DEGREES = 12.0


@dataclass(frozen=True)
class _Setting:
    """Where the left ear grows: values along its n loops, positions in mm."""

    angle: np.ndarray  # (n,) direction on the window, radians
    phase: np.ndarray  # (n,) place on the outline, 0..1
    attached: np.ndarray  # (n, 2) chart points of the seam on the head
    seam: np.ndarray  # (n, 3)
    frame: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]

    def along(self, values: np.ndarray) -> np.ndarray:
        """Values at the points of the outline, smoothly between them (n, ...)."""
        knots = np.linspace(0, 1, len(values) + 1)
        closed = np.concatenate([values, values[:1]])
        return CubicSpline(knots, closed, bc_type="periodic")(self.phase)

    def in_plane(self, plane: np.ndarray, height: np.ndarray) -> np.ndarray:
        """(n, 3) positions of points (backward, up) of the ear's plane and heights above it."""
        origin, back, up, out = self.frame
        return origin + plane[:, :1] * back + plane[:, 1:] * up + height[:, None] * out


def _setting(surface: BaseSurface, window_chart: np.ndarray) -> _Setting:
    """The setting of the left ear inside its window border (n, 2)."""
    low, high = window_chart.min(axis=0), window_chart.max(axis=0)
    relative = (window_chart - 0.5 * (low + high)) / (high - low)
    angle = np.unwrap(np.arctan2(relative[:, 1], relative[:, 0]))
    angle += 2 * np.pi * np.round((np.pi - angle[0]) / (2 * np.pi))
    fine = np.linspace(0, 1, 2001)
    knots = np.linspace(0, 1, len(_OUTLINE) + 1)
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
    attached = np.stack(
        [7.36 + 0.29 * np.cos(angle), 0.5 * (low + high)[1] + 3.0 * np.sin(angle)], axis=-1
    )
    return _Setting(angle, phase, attached, surface.point(*attached.T), _frame(surface))


def ear_patch(surface: BaseSurface, window_chart: np.ndarray) -> Patch:
    """Loops of the left ear inside its window border (n, 2); the last loop is to be capped."""
    setting = _setting(surface, window_chart)
    outline = setting.along(_OUTLINE)
    free, curl, tragus = (np.clip(setting.along(v), 0, 1) for v in (_FREE, _CURL, _TRAGUS))
    seam = setting.seam
    edge = setting.in_plane(_CENTER + _LOOPS[0][0] * (outline - _CENTER), _LOOPS[0][1] * free)
    # The back of the ear leaves the head steeply, then turns outward.
    positions = [seam, seam + 0.45 * (edge - seam)]
    for scale, curled, flat in _LOOPS:
        height = curl * curled + (1 - curl) * flat
        height = height + tragus * 2.2 * np.exp(-(((scale - 0.72) / 0.16) ** 2))
        point = setting.in_plane(_CENTER + scale * (outline - _CENTER), height)
        # In front there is no rim: the loops run from the face straight to the tragus.
        attach = (1 - free) * np.clip((scale - 0.75) / 0.25, 0, 1)
        positions.append(point + attach[:, None] * 0.8 * (seam - point))
    attached = setting.attached
    center = attached.mean(axis=0)
    shrink = np.linspace(1, 0.12, len(positions))[:, None, None]
    chart = center + shrink * (np.stack([attached] * len(positions)) - center)
    return Patch(np.stack(positions), chart)


def folded_ear(surface: BaseSurface, window_chart: np.ndarray) -> np.ndarray:
    """(loops, n, 3) positions in mm, for the loops of `ear_patch` of the left ear."""
    setting = _setting(surface, window_chart)
    folds = setting.along(_FOLDS)
    outline, rim = folds[:, :2], folds[:, 2:4]
    rim_height, helix, groove = folds[:, 4:7].T
    free = np.clip(folds[:, 7:], 0, 1)
    seam, tragus = setting.seam, setting.in_plane(rim, rim_height)
    loops = [
        (_CENTER + scale * (outline - _CENTER), share * helix + min(share, 0.0))
        for scale, share in _RIM
    ]
    inner = loops[-1][0]
    for place, share in _SLOPE:
        plane = inner + place * (rim - inner)
        outer = 0.9 * helix if place < 0.4 else rim_height
        height = share * groove + (1 - share) * outer + _ridge(plane, *_UPPER_CRUS)
        loops.append((plane, height))
    positions = [seam, seam]
    for (plane, height), share in zip(loops, _FROM_CHEEK, strict=True):
        cheek = seam + share * (tragus - seam)
        positions.append(cheek + free * (setting.in_plane(plane, height) - cheek))
    positions[1] = seam + 0.45 * (positions[2] - seam)
    for scale, share, depth in _BOWL:
        plane = _CANAL + scale * (rim - _CANAL)
        positions.append(
            setting.in_plane(plane, share * rim_height + depth + _ridge(plane, *_HELIX_ROOT))
        )
    return np.stack(positions)


def _ridge(
    plane: np.ndarray, start: np.ndarray, end: np.ndarray, width: float, height: float
) -> np.ndarray:
    """(n,) mm above points of the plane (n, 2)."""
    distance, _ = to_segment(plane, start, end)
    return height * np.exp(-((distance / width) ** 2))


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
