"""Ninety expression blendshapes: the 52 ARKit shapes, then shapes named after FACS action units and
visemes.

FACS: Ekman and Friesen 1978, "Facial Action Coding System". Displacements in mm at weight 1, full
natural strength.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from facestage.contract.arkit import ARKIT_NAMES
from facestage.models.head import eyes, lids, mouth
from facestage.models.head.assemble import SIDES
from facestage.models.head.expression_table import BOTH, ONE_SIDED, Fold, Muscle
from facestage.models.head.features import to_segment
from facestage.models.head.masks import JAW_HINGE, Masks, eye_center, rotate_about, smoothstep

_JAW_OPEN_DEGREES = 21.0


def expressions(masks: Masks) -> tuple[tuple[str, ...], np.ndarray]:
    """Names and displacements (90, n, 3) float64 in mm at weight 1: ARKit names first."""
    shapes = {name: pulled(masks, muscles, None) for name, muscles in BOTH.items()}
    for stem, muscles in ONE_SIDED.items():
        for side in SIDES:
            shapes[_sided(stem, side)] = pulled(masks, muscles, side)
    shapes |= _jaw_shapes(masks)
    shapes |= {"mouthLeft": _mouth_sideways(masks, 1.0), "mouthRight": _mouth_sideways(masks, -1.0)}
    for side in SIDES:
        for name, extra in _eye_shapes(masks, side).items():
            shapes[_sided(name, side)] = shapes.get(_sided(name, side), 0.0) + extra
    shapes = {name: _kept_off_eyes(masks, shape) for name, shape in shapes.items()}
    extras = [name for name in shapes if name not in ARKIT_NAMES]
    names = ARKIT_NAMES + tuple(extras)
    return names, np.stack([shapes[name] for name in names])


def _sided(stem: str, side: str) -> str:
    """ARKit names end in Left or Right, the others in _left or _right."""
    return f"{stem}_{side}" if "_" in stem else stem + side.capitalize()


def pulled(masks: Masks, pulls: tuple[Muscle | Fold, ...], side: str | None) -> np.ndarray:
    """Sum of pulls and folds on both sides, or on one side only."""
    result = np.zeros((masks.count, 3))
    for each in SIDES if side is None else (side,):
        for pull in pulls:
            result += (
                _fold(masks, pull, each) if isinstance(pull, Fold) else _muscle(masks, pull, each)
            )
    return result


def _fold(masks: Masks, fold: Fold, side: str) -> np.ndarray:
    """(n, 3) the step of a fold, outwards over the surface of the cheek."""
    sign = 1.0 if side == "left" else -1.0
    front = masks.points[:, :2] * [sign, 1.0]
    line = np.array(fold.line, np.float64)
    nearest = np.full(masks.count, np.inf)
    across, along = np.zeros(masks.count), np.zeros(masks.count)
    lengths = np.linalg.norm(np.diff(line, axis=0), axis=1)
    before = np.concatenate([[0.0], np.cumsum(lengths)])
    for k, (start, end) in enumerate(pairwise(line)):
        distance, part = to_segment(front, start, end)
        axis, away = end - start, front - start
        outer = np.sign(away[:, 1] * axis[0] - away[:, 0] * axis[1])
        here = distance < nearest
        nearest[here] = distance[here]
        across[here] = (outer * distance)[here] / fold.width
        along[here] = (before[k] + part * lengths[k])[here] / before[-1]
    step = fold.height * across * np.exp(0.5 - 0.5 * across**2) * np.sin(np.pi * along)
    outwards = np.array([0.45 * sign, 0.0, 0.89])
    return (step * masks.front)[:, None] * outwards


def _muscle(masks: Masks, muscle: Muscle, side: str) -> np.ndarray:
    sign = 1.0 if side == "left" else -1.0
    points = masks.points
    offset = (points[:, :2] - np.array(muscle.center) * [sign, 1]) / muscle.radii
    weight = np.exp(-(offset**2).sum(axis=1)) * masks.front
    # The inside of the mouth follows the lips only near them.
    weight = weight * smoothstep((points[:, 2] - 62.0) / 22.0) if muscle.lip else weight
    if muscle.lip == "upper":
        weight = weight * (1 - masks.below_mouth)
    elif muscle.lip == "lower":
        weight = weight * masks.below_mouth
    half = masks.left if side == "left" else 1 - masks.left
    if muscle.center[0] == 0:
        weight = weight * half
    else:
        # A pull reaches over the midline a little, never over the whole other side.
        weight = weight * smoothstep(0.5 + sign * points[:, 0] / 24.0)
    return weight[:, None] * np.array(muscle.move) * [sign, 1, 1]


def _jaw_shapes(masks: Masks) -> dict[str, np.ndarray]:
    points, jaw = masks.points, masks.jaw[:, None]
    opened = _jaw_turn(masks, _JAW_OPEN_DEGREES)
    forward = jaw * np.array([0.0, -0.6, 8.0])
    sideways = rotate_about(points, JAW_HINGE, 1, np.radians(4.5)) - points
    left = jaw * (sideways + np.array([1.0, 0.0, 0.0]))
    right = jaw * (rotate_about(points, JAW_HINGE, 1, -np.radians(4.5)) - points - [1.0, 0.0, 0.0])
    # With jawOpen at 1, mouthClose brings the lips together again between the parted teeth.
    lips = np.exp(-(((points[:, 1] + 77) / 15.0) ** 2) - (points[:, 0] / 30.0) ** 4) * masks.front
    lips = lips * smoothstep((points[:, 2] - 68.0) / 12.0)
    lips[masks.mesh.loops["mouth"][5:]] = 1.0
    gap = opened[masks.mesh.loops["mouth"][mouth.LIP_LOOPS]]
    n = len(gap)
    # The lower lip at the midline moves furthest; the upper one comes to meet it, but stays before
    # the upper teeth.
    middle = gap[n // 4] * [0.35, 0.35, 0.14]
    bell = np.clip(1 - (points[:, 0] / 34.0) ** 2, 0.0, 1.0)[:, None]
    close = lips[:, None] * (-opened + bell * middle)
    return {
        "jawOpen": opened,
        "jawForward": forward,
        "jawLeft": left,
        "jawRight": right,
        "mouthClose": close,
        "tongueOut": _tongue_out(masks),
        "jaw_back": jaw * np.array([0.0, 0.8, -3.5]),
    }


def _jaw_turn(masks: Masks, degrees: float) -> np.ndarray:
    angle = np.radians(degrees) * masks.jaw
    moved = rotate_about(masks.points, JAW_HINGE, 0, angle) - masks.points
    # The condyles slide forward as the jaw opens.
    moved[:, 2] += 0.12 * degrees * masks.jaw
    # The corners are drawn in and the cheeks flatten.
    corner = np.exp(
        -(((np.abs(masks.points[:, 0]) - 26) / 12) ** 2) - ((masks.points[:, 1] + 75) / 14) ** 2
    )
    moved[:, 0] -= np.sign(masks.points[:, 0]) * corner * masks.front * degrees * 0.10
    return moved


def _mouth_sideways(masks: Masks, sign: float) -> np.ndarray:
    """The mouth drawn to the subject's left (sign 1) or right (-1); that corner goes further and
    back.
    """
    x, y = masks.points[:, 0] * sign, masks.points[:, 1]
    deep = smoothstep((masks.points[:, 2] - 62.0) / 22.0)
    bell = np.exp(-((x / 34.0) ** 2) - ((y + 73.0) / 17.0) ** 2) * masks.front * deep
    corner = np.exp(-(((x - 26.0) / 15.0) ** 2) - ((y + 73.0) / 14.0) ** 2) * masks.front * deep
    return np.stack([sign * (11.0 * bell + 1.5 * corner), 2.0 * corner, -4.0 * corner], axis=-1)


def _tongue_out(masks: Masks) -> np.ndarray:
    index = masks.mesh.tongue
    result = np.zeros((masks.count, 3))
    along = smoothstep((masks.points[index, 2] - 50.0) / 30.0)
    result[index] = along[:, None] * np.array([0.0, -3.0, 30.0])
    return result


def _eye_shapes(masks: Masks, side: str) -> dict[str, np.ndarray]:
    inward = -1.0 if side == "left" else 1.0
    follow_down = lids.close_lids(masks, side, 0.42, -0.12)
    follow_up = lids.close_lids(masks, side, -0.22, 0.10)
    return {
        "eyeBlink": lids.close_lids(masks, side, 1.0, 1.0),
        "eyeSquint": lids.close_lids(masks, side, 0.04, 1.2),
        "eyeWide": lids.close_lids(masks, side, -0.34, -0.12),
        "eyeLookDown": lids.look(masks, side, 0, -25) + follow_down,
        "eyeLookUp": lids.look(masks, side, 0, 22) + follow_up,
        "eyeLookIn": lids.look(masks, side, inward * 28, 0),
        "eyeLookOut": lids.look(masks, side, -inward * 28, 0),
        "AU46_wink": lids.close_lids(masks, side, 0.8, 1.0),
        "AU7_lower_lid_raiser": lids.close_lids(masks, side, 0.0, 0.9),
        "lower_lid_lower": lids.close_lids(masks, side, 0.0, -0.45),
    }


def _kept_off_eyes(masks: Masks, shape: np.ndarray) -> np.ndarray:
    """Skin pushed into an eyeball slides over it instead."""
    for side in SIDES:
        near = masks.skin & (masks.eye_distance(side) < 20.0)
        near[masks.mesh.loops[f"eye_{side}"][eyes.MARGIN + 1 :]] = False
        rest = masks.points[near]
        shape[near] = lids.lifted(rest + shape[near], rest, eye_center(side)) - rest
    return shape
