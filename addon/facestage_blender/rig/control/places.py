"""Where handles stand and how far they go, from how sliders move the skin. No bpy: plain arrays in
the model frame, metres.

Nothing but a face's sliders is asked, so that any mesh with ARKit's expressions gets a rig: a
handle stands where its slider moves the skin most, and its way is as long as that of the skin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float

from .handles import JAW, TARGET, TARGETS, Drive, Handle

WAY_MIN, WAY_MAX = 0.005, 0.025  # of a handle at 1, metres
TURN_MIN, TURN_MAX = np.radians(3.0), np.radians(45.0)
USUAL_EYE, USUAL_JAW = np.radians(25.0), np.radians(18.0)
NEAR = 0.002  # of a place within which the foremost vertex is taken, metres
LOOK = 0.3  # from the eyes to what they look at, metres
AHEAD, FLOATING = 0.02, ("mouth", "tongue")  # of these handles from the lips, metres
EYEBALL = 0.013  # metres from its middle to the pupil
SEEN = 1e-4  # metres that the skin moves at least
STRONG = 0.6  # of the strongest motion
LEFT, UP, FRONT = np.eye(3)

Way = tuple[bool, int, int]  # of a drive: turn, axis, sign


@dataclass(frozen=True)
class Face:
    """A face at rest and how its sliders move it."""

    points: Float[np.ndarray, "points 3"]
    moves: Mapping[str, Float[np.ndarray, "points 3"]]  # by slider
    skin: Bool[np.ndarray, " points"]
    eyes: Bool[np.ndarray, " points"]
    teeth: Bool[np.ndarray, " points"]


@dataclass(frozen=True)
class Place:
    """A bone of a handle."""

    head: Float[np.ndarray, " 3"]
    tail: Float[np.ndarray, " 3"]
    front: Float[np.ndarray, " 3"]  # the direction of its Z
    ways: Mapping[Way, float]  # metres or radians at 1
    mark: Float[np.ndarray, " 3"]  # where it is drawn


def places(face: Face, handles: Sequence[Handle]) -> dict[str, Place]:
    """The places of the handles, and of head, neck and what the eyes look at, by bone."""
    found: dict[str, Place] = {}
    for handle in handles:
        if handle.name == JAW.name:
            found[handle.name] = _jaw(face, handle)
        elif handle.name in TARGETS:
            found[handle.name] = _eye(face, handle)
        else:
            found[handle.name] = _skin_place(face, handle)
    eyes = [found[name] for name in TARGETS if name in found]
    for name, target in TARGETS.items():
        if name in found:
            at = found[name].head + LOOK * FRONT
            found[target] = Place(at, at + 0.01 * UP, FRONT, {}, at)
    if eyes:
        at = np.mean([each.head for each in eyes], axis=0) + LOOK * FRONT
        found[TARGET] = Place(at, at + 0.02 * UP, FRONT, {}, at)
    return found | _whole(face, found.get(JAW.name))


def size(face: Face) -> float:
    """Half the width of the skin, metres: how large the head's own bones are drawn."""
    return 0.5 * float(np.ptp(face.points[face.skin][:, 0]))


def _whole(face: Face, jaw: Place | None) -> dict[str, Place]:
    """Head and neck: the head nods about the top of the neck, between the jaw's joints."""
    skin = face.points[face.skin]
    low, high = skin.min(axis=0), skin.max(axis=0)
    nod = 0.5 * (low + high) if jaw is None else jaw.head
    nod = np.array([0.0, nod[1], min(nod[2], 0.5 * (low[2] + high[2]))])
    top = np.array([0.0, high[1], nod[2]])
    root = np.array([0.0, nod[1] - 0.85 * (high[1] - nod[1]), nod[2] - 0.01])
    return {
        "neck": Place(root, nod - 1e-3 * UP, FRONT, {}, root),
        "head": Place(nod, top, FRONT, {}, top),
    }


def _skin_place(face: Face, handle: Handle) -> Place:
    axis, sign = handle.toward
    if axis == 0 and handle.side:
        sign *= handle.side
    move, skin = face.moves[handle.at], np.flatnonzero(face.skin)
    seen = skin if np.abs(move[skin]).max(initial=0.0) > SEEN else np.flatnonzero(~face.skin)
    points, along = face.points[seen], sign * move[seen, axis]
    if handle.side:
        along = np.where(handle.side * points[:, 0] > 0, along, 0.0)
    if handle.beside:
        other = np.linalg.norm(face.moves[handle.beside][seen], axis=1)
        along = along / max(along.max(initial=0.0), SEEN) - other / max(
            other.max(initial=0.0), SEEN
        )
    weight = _peaked(np.maximum(along, 0.0))
    if weight.sum() <= 0:  # it moves another way: where it moves at all
        points, weight = face.points, _peaked(np.linalg.norm(move, axis=1)) + 1e-30
    at = weight @ points / weight.sum()
    if not handle.side:
        at[0] = 0.0
    surface = face.points[skin]
    apart = np.hypot(surface[:, 0] - at[0], surface[:, 1] - at[1])
    near = np.flatnonzero(apart <= max(NEAR, float(apart.min())))
    at = surface[near[surface[near, 2].argmax()]].copy()
    if not handle.side:
        at[0] = 0.0
    if handle.name in FLOATING:
        at += AHEAD * FRONT
    return Place(at, at + 0.006 * UP, FRONT, _ways(face, handle), at)


def _peaked(motion: np.ndarray) -> np.ndarray:
    """How much vertices count for a place: the fourth power of their motion."""
    squared = motion * motion
    weight: np.ndarray = squared * squared
    return weight


def _ways(face: Face, handle: Handle) -> dict[Way, float]:
    """How far the skin goes in each direction of the handle's; several sliders share it."""
    ways: dict[Way, list[float]] = {}
    skin = np.flatnonzero(face.skin)
    for drive in handle.drives:
        along = drive.sign * face.moves[drive.slider][skin, drive.axis]
        ways.setdefault(way_of(drive), []).append(float(along.max(initial=0.0)))
    return {way: float(np.clip(np.mean(each), WAY_MIN, WAY_MAX)) for way, each in ways.items()}


def way_of(drive: Drive) -> Way:
    """The direction that a drive is; others may share it."""
    return drive.turn, drive.axis, drive.sign


def _eye(face: Face, handle: Handle) -> Place:
    """An eyeball's middle, and how far its sliders turn it (Arun, Huang and Blostein 1987)."""
    ball = face.eyes & (handle.side * face.points[:, 0] > 0)
    if ball.any():
        points = face.points[ball]
        middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    else:  # a mesh whose eyes nobody has named
        motions = [np.linalg.norm(face.moves[each.slider], axis=1) for each in handle.drives]
        moved = np.max(motions, axis=0)
        weight = _peaked(moved) + 1e-30
        middle = weight @ face.points / weight.sum() - EYEBALL * FRONT
    ways = {}
    for drive in handle.drives:
        angle = USUAL_EYE
        if ball.any():
            angle = _turned(face.points[ball], face.moves[drive.slider][ball])
        ways[way_of(drive)] = float(np.clip(angle, TURN_MIN, TURN_MAX))
    return Place(middle, middle + 0.02 * FRONT, -UP, ways, middle + EYEBALL * FRONT)


def _turned(points: np.ndarray, move: np.ndarray) -> float:
    """The angle of the rotation that explains best where points go."""
    before, after = points - points.mean(axis=0), points + move - (points + move).mean(axis=0)
    left, _, right = np.linalg.svd(before.T @ after)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    rotation = right.T @ flip @ left.T
    return float(np.arccos(np.clip((np.trace(rotation) - 1) / 2, -1, 1)))


def _jaw(face: Face, handle: Handle) -> Place:
    """The jaw's joints, and how far its sliders turn it about them.

    The joints' axis runs from left to right; where it is follows from where *jawOpen* takes what
    moves most: a rotation in the face's plane of symmetry.
    """
    open_ = next((each.slider for each in handle.drives if each.turn and each.axis == 0), "")
    skin = face.points[face.skin]
    joint, angle = _usual_joint(skin), USUAL_JAW
    chin = np.array([0.0, skin[:, 1].min(), skin[:, 2].max()])
    if open_:
        move = face.moves[open_]
        reach = np.linalg.norm(move, axis=1)
        most = face.skin & (reach > STRONG * reach[face.skin].max(initial=0.0))
        # Teeth turn as the bone does, skin more softly.
        bone = face.teeth & (reach > STRONG * reach[face.teeth].max(initial=SEEN))
        if most.sum() > 2:
            hard = bone if bone.sum() > 2 else most
            joint, angle = _hinge(face.points[hard], move[hard], joint)
            near = most & (np.abs(face.points[:, 0]) < 0.006)
            front = face.points[near if near.any() else most]
            chin = front[(front[:, 2] - front[:, 1]).argmax()] * [0.0, 1.0, 1.0]
    arm = max(float(chin[2] - joint[2]), 0.03)
    ways: dict[Way, float] = {}
    for drive in handle.drives:
        if drive.turn and drive.axis == 0:
            ways[way_of(drive)] = float(np.clip(angle, TURN_MIN, TURN_MAX))
        else:
            along = np.abs(face.moves[drive.slider][face.skin, 0 if drive.turn else 2])
            way = float(np.clip(along.max(initial=0.0), WAY_MIN, WAY_MAX))
            ways[way_of(drive)] = float(np.arcsin(min(way / arm, 0.7))) if drive.turn else way
    return Place(joint, joint + arm * FRONT, -UP, ways, chin)


def _usual_joint(skin: np.ndarray) -> np.ndarray:
    """Where jaws have their joints, by the head's box."""
    low, high = skin.min(axis=0), skin.max(axis=0)
    return np.array([0.0, 0.5 * (low[1] + high[1]), high[2] - 0.4 * (high[0] - low[0])])


def _hinge(points: np.ndarray, move: np.ndarray, usual: np.ndarray) -> tuple[np.ndarray, float]:
    """Middle and angle of the plane rotation that explains a jaw's motion; the usual middle where
    the motion is too straight to say.
    """
    before, after = points[:, 1:], (points + move)[:, 1:]
    a, b = before - before.mean(axis=0), after - after.mean(axis=0)
    angle = float(np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum()))
    if angle > TURN_MIN:
        cos, sin = np.cos(angle), np.sin(angle)
        turn = np.array([[cos, -sin], [sin, cos]])
        middle = np.linalg.solve(np.eye(2) - turn, after.mean(axis=0) - turn @ before.mean(axis=0))
        if np.abs(middle - usual[1:]).max() < 0.06:
            return np.array([0.0, *middle]), angle
    arm = np.linalg.norm(before.mean(axis=0) - usual[1:])
    return usual, float(np.linalg.norm(move, axis=1).mean() / max(arm, 0.03))
