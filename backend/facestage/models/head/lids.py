"""Motions of eyelids and eyeballs: lids turn about the eye's centre, so they slide over the
eyeball.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from facestage.models.head import eyes
from facestage.models.head.caruncle import flesh_share
from facestage.models.head.features import EYE_RADIUS
from facestage.models.head.masks import Masks, eye_center, rotate_about, smoothstep

CLEARANCE = EYE_RADIUS + 0.75 * eyes.LID_THICKNESS


def close_lids(masks: Masks, side: str, upper: float, lower: float) -> np.ndarray:
    """(n, 3) mm: each lid moved by a share of its way to the line where the lids meet; negative
    opens further.
    """
    result = np.zeros((masks.count, 3))
    loops = masks.mesh.loops[f"eye_{side}"]
    n = loops.shape[1]
    center = eye_center(side)
    elevation = _elevation(masks.points[loops[eyes.MARGIN]] - center)
    opposite = elevation[_opposite(n)]
    is_upper = np.arange(n) > n // 2
    upper_edge, lower_edge = (
        np.where(is_upper, elevation, opposite),
        np.where(is_upper, opposite, elevation),
    )
    meeting = lower_edge + 0.22 * (upper_edge - lower_edge)
    turn = np.where(is_upper, upper, lower) * (meeting - elevation)
    # Both edges end on the same points, so that nothing gapes.
    margin = masks.points[loops[eyes.MARGIN]] - center
    reach = np.hypot(margin[:, 1], margin[:, 2])
    # Shut lids arch a little more, or half-way along the straight path of a shape key they would
    # cut into the eye.
    x = 0.5 * (margin[:, 0] + margin[_opposite(n), 0])
    arch = np.sqrt(np.maximum((EYE_RADIUS + 2.0) ** 2 - x**2, 0.0)) * smoothstep(
        (upper_edge - lower_edge) / 0.5
    )
    reach = np.maximum(np.maximum(reach, reach[_opposite(n)]), arch)
    met = center + np.stack([x, reach * np.sin(meeting), reach * np.cos(meeting)], axis=-1)
    share = np.clip(np.where(is_upper, upper, lower), 0.0, 1.0)[:, None]
    rest = share * (met - rotate_about(margin + center, center, 0, -(meeting - elevation)))
    # Skin further from the margin follows less: the fold of the lid takes up the rest.
    follow = (
        np.concatenate([[0.0], 1.15 * np.array(eyes.LID_LOOPS) - 0.13, [1.0, 1.0, 1.0]]).clip(0, 1)
        ** 1.3
    )
    # Lids slide over the flesh in their corners.
    flesh = flesh_share(n, side)
    for ring, row in enumerate(loops):
        here = masks.points[row]
        moved = rotate_about(here, center, 0, -follow[ring] * turn) + follow[ring] * rest
        if ring <= eyes.MARGIN:
            moved = lifted(moved, here, center)
            result[row] = moved - here
        else:
            result[row] = (1 - flesh[:, None]) * (moved - here)
    return result


def lifted(moved: np.ndarray, rest: np.ndarray, center: np.ndarray) -> np.ndarray:
    """Moved points (m, 3) pushed out of the eyeball, but no further out than clearance or where
    they rested.
    """
    relative = moved - center
    radius = np.linalg.norm(relative, axis=1, keepdims=True)
    rest_radius = np.linalg.norm(rest - center, axis=1, keepdims=True)
    return center + relative / radius * np.maximum(radius, np.minimum(rest_radius, CLEARANCE))


def widen(masks: Masks, side: str, amount: float) -> np.ndarray:
    """(n, 3) mm: the lid opening lengthened by `amount` mm, sliding over the eyeball."""
    outward = 1.0 if side == "left" else -1.0
    loops = masks.mesh.loops[f"eye_{side}"]
    follow = np.concatenate([[0.0], eyes.LID_LOOPS, [1.0, 1.0, 1.0]]) ** 1.2
    return _slide(
        masks,
        side,
        loops,
        follow,
        lambda along: np.stack([amount * outward * along, 0 * along], axis=-1),
    )


def tilt(masks: Masks, side: str, rise: float) -> np.ndarray:
    """(n, 3) mm: the outer corner raised and the inner lowered by half of `rise` mm."""
    loops = masks.mesh.loops[f"eye_{side}"]
    follow = np.concatenate([[0.0], eyes.LID_LOOPS, [1.0, 1.0, 1.0]])
    return _slide(
        masks, side, loops, follow, lambda along: np.stack([0 * along, rise * along], axis=-1)
    )


def look(masks: Masks, side: str, yaw: float, pitch: float) -> np.ndarray:
    """(n, 3) mm: the eyeball turned by degrees, yaw towards the subject's left, pitch upwards."""
    result = np.zeros((masks.count, 3))
    index = masks.mesh.eyeballs[side]
    center = eye_center(side)
    turned = rotate_about(masks.points[index], center, 0, -np.radians(pitch))
    turned = rotate_about(turned, center, 1, np.radians(yaw))
    result[index] = turned - masks.points[index]
    return result


def _slide(
    masks: Masks,
    side: str,
    loops: np.ndarray,
    follow: np.ndarray,
    move: Callable[[np.ndarray], np.ndarray],
) -> np.ndarray:
    """Front view moves (m, 2) of `along` (-0.5 at the inner, 0.5 at the outer corner), kept on the
    eyeball.
    """
    result = np.zeros((masks.count, 3))
    center = eye_center(side)
    span = 0.5 * (eyes.OUTER_CORNER[0] - eyes.INNER_CORNER[0])
    outward = 1.0 if side == "left" else -1.0
    for ring, row in enumerate(loops):
        here = masks.points[row]
        along = np.clip((here[:, 0] - center[0]) * outward / span, -1.3, 1.3) * 0.5
        moved = here.copy()
        moved[:, :2] += follow[ring] * move(along)
        radius = np.linalg.norm(here - center, axis=1, keepdims=True)
        relative = moved - center
        on_eye = np.exp(-((np.maximum(radius - CLEARANCE, 0.0) / 3.0) ** 2))
        kept = relative / np.linalg.norm(relative, axis=1, keepdims=True) * radius
        result[row] = center + relative + on_eye * (kept - relative) - here
    return result


def _opposite(n: int) -> np.ndarray:
    return (n - np.arange(n)) % n


def _elevation(relative: np.ndarray) -> np.ndarray:
    return np.arctan2(relative[:, 1], relative[:, 2])
