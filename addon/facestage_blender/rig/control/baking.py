"""Moves what sliders say onto the handles: the face as it is, or all keys.

Drivers are turned round: handle after handle takes as much of its sliders as it can say. What no
handle can say (a smile and a frown of one corner, a slider without a handle) stays on the slider,
so that the face does not change.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import bpy
import numpy as np
from mathutils import Quaternion

from facestage.contract.arrays import Float
from facestage.contract.errors import InputError

from ..face_rig import require_rig
from ..keyframes import curves_of, own_actions, remove_curves, write_curve, write_keys
from ..sliders import control_rig, is_bound, rest_handles, set_slider, slider_path
from .armature import AXES, LIMIT, LIMIT_TURN
from .binding import Term, read_terms
from .handles import ALL, TARGET, TARGETS
from .reading import full_values

FAINT = 1e-5  # of a slider: nothing, as places of handles are rounded

Channel = tuple[str, bool, int]  # of a handle: bone, turn, axis
Weights = dict[str, Float[np.ndarray, " frames"]]  # by slider


def bake_to_handles(scene: bpy.types.Scene) -> int:
    """Move the expression of the scene's face from its sliders to the handles, with all keys that
    the sliders have; returns how many frames were keyed, 0 where nothing had keys.

    Handles that are keyed already keep their keys, and their sliders theirs. Raises InputError
    without a control rig.
    """
    rig = require_rig(scene)
    armature = control_rig(rig)
    if armature is None:
        raise InputError("The face has no control rig; press Add Control Rig first.")
    bpy.context.view_layer.update()
    shapes, keyed = rig.data.shape_keys, _keyed_bones(armature)
    keys = {key.name: key for key in shapes.key_blocks if is_bound(key)}
    terms = [each for each in read_terms(rig) if not _driving(each.bone) & keyed]
    frames, weights = _weights(shapes, keys)
    for term in terms:  # what handles are posed to goes the same way
        weights[term.slider] += term.slope * max(0.0, term.sign * _posed(armature, term))
    moved = _taken(armature, terms, weights, full_values(rig))
    rest_handles(rig)
    for bone, path, axis, values in _places(armature, moved):
        if len(frames) and np.ptp(values) > 0:
            bone.keyframe_insert(path, index=axis, frame=float(frames[0]))
            write_curve(armature, bone.path_from_id(path), axis, frames, values)
        getattr(bone, path)[axis] = values[0]
    _write_rest(rig, frames, weights)
    scene.frame_set(scene.frame_current, subframe=scene.frame_subframe)
    return len(frames)


def _driving(bone: str) -> set[str]:
    """The bones by which a handle is moved."""
    return {TARGETS[bone], TARGET} if bone in TARGETS else {bone}


def _keyed_bones(armature: bpy.types.Object) -> set[str]:
    paths = [curve.data_path for curve in curves_of(armature)]
    return {
        bone.name
        for bone in armature.pose.bones
        if any(path.startswith(f"{bone.path_from_id()}.") for path in paths)
    }


def _weights(
    shapes: bpy.types.Key, keys: Mapping[str, bpy.types.ShapeKey]
) -> tuple[Float[np.ndarray, " frames"], Weights]:
    """All frames from the first key to the last, and every slider's values there; one value each
    where nothing has keys.
    """
    paths = {slider_path(key): name for name, key in keys.items()}
    curves = {
        paths[curve.data_path]: curve for curve in curves_of(shapes) if curve.data_path in paths
    }
    at = np.array([point.co[0] for each in curves.values() for point in each.keyframe_points])
    if len(at):
        at = np.union1d(at, np.arange(np.ceil(at.min()), np.floor(at.max()) + 1))
    weights = {name: np.full(max(len(at), 1), float(shapes[name])) for name in keys}
    for name, curve in curves.items():
        weights[name] = np.array([curve.evaluate(float(frame)) for frame in at])
    return at, weights


def _posed(armature: bpy.types.Object, term: Term) -> float:
    """Where a handle is on its way, its limits respected, as drivers see it."""
    bone = armature.pose.bones[term.bone]
    local = armature.convert_space(
        pose_bone=bone, matrix=bone.matrix, from_space="POSE", to_space="LOCAL"
    )
    if not term.turn:
        return float(local.translation[term.axis])
    if term.bone not in TARGETS:
        return float(local.to_euler("XYZ")[term.axis])
    turn = local.to_quaternion()
    swing = turn @ Quaternion((turn.w, 0.0, turn.y, 0.0)).normalized().inverted()
    return float(2 * np.arcsin(swing[1 + term.axis]))


def _taken(
    armature: bpy.types.Object, terms: Sequence[Term], weights: Weights, full: Mapping[str, float]
) -> dict[Channel, Float[np.ndarray, " frames"]]:
    """How far each handle goes along or about each axis; ``weights`` keep what is left."""
    order = {handle.name: place for place, handle in enumerate(ALL)}
    ways: dict[tuple[Channel, int], list[Term]] = {}
    for term in sorted(terms, key=lambda each: order.get(each.bone, len(order))):
        ways.setdefault(((term.bone, term.turn, term.axis), term.sign), []).append(term)
    open_ = dict.fromkeys(weights, 0.0)  # what the handles still to come could say
    length = {way: _length(armature, way, each, full) for way, each in ways.items()}
    for way, each in ways.items():
        for term in each:
            open_[term.slider] += term.slope * length[way]
    moved: dict[Channel, np.ndarray] = {}
    for channel in dict.fromkeys(channel for channel, _ in ways):
        both = [(channel, sign) for sign in (1, -1) if (channel, sign) in ways]
        shares = [
            np.clip(
                np.min(
                    [weights[t.slider] / min(full[t.slider], open_[t.slider]) for t in ways[way]],
                    axis=0,
                ),
                0.0,
                1.0,
            )
            for way in both
        ]
        chosen = np.argmax(shares, axis=0)  # a handle goes one way at a time
        moved[channel] = np.zeros(len(chosen))
        for place, way in enumerate(both):
            share = np.where(chosen == place, shares[place], 0.0)
            moved[channel] += way[1] * length[way] * share
            for term in ways[way]:
                weights[term.slider] = weights[term.slider] - term.slope * length[way] * share
                open_[term.slider] -= term.slope * length[way]
    return moved


def _length(
    armature: bpy.types.Object,
    way: tuple[Channel, int],
    terms: Sequence[Term],
    full: Mapping[str, float],
) -> float:
    """How far a handle may go; an eye, as far as its slider needs."""
    (name, turn, axis), sign = way
    limit = armature.pose.bones[name].constraints.get(LIMIT_TURN if turn else LIMIT)
    if limit is None:
        return min(full[term.slider] / term.slope for term in terms)
    return abs(float(getattr(limit, f"{'max' if sign > 0 else 'min'}_{AXES[axis]}")))


def _places(
    armature: bpy.types.Object, moved: Mapping[Channel, np.ndarray]
) -> list[tuple[bpy.types.PoseBone, str, int, np.ndarray]]:
    """Bone, property, axis and values of what puts the handles where they belong."""
    bones, found = armature.pose.bones, []
    for (name, turn, axis), values in moved.items():
        if name not in TARGETS:
            path = "rotation_euler" if turn else "location"
            found.append((bones[name], path, axis, values))
    for name, target in TARGETS.items():
        if (name, True, 0) not in moved and (name, True, 2) not in moved:
            continue
        still = np.zeros(len(next(iter(moved.values()))))
        x, z = (np.sin(0.5 * moved.get((name, True, axis), still)) for axis in (0, 2))
        w = np.sqrt(np.maximum(1 - x**2 - z**2, 0))
        ahead = 1 - 2 * (x**2 + z**2)  # the eye's Y after its turn, in its own axes
        eye, far = bones[name].bone, bones[target].bone
        away = (far.head_local - eye.head_local).length
        found.append((bones[target], "location", 0, -2 * w * z / ahead * away))
        found.append((bones[target], "location", 1, -2 * w * x / ahead * away))
    return found


def _write_rest(rig: bpy.types.Object, frames: np.ndarray, weights: Weights) -> None:
    """What the handles left, back on the sliders."""
    shapes = rig.data.shape_keys
    own_actions(shapes)
    rest = {name: np.where(abs(each) < FAINT, 0.0, each) for name, each in weights.items()}
    still = {name for name, each in rest.items() if np.ptp(each) < FAINT}
    remove_curves(shapes, {slider_path(shapes.key_blocks[name]) for name in still})
    for name in still:
        set_slider(shapes.key_blocks[name], float(rest[name][0]))
    write_keys(rig, frames, {name: each for name, each in rest.items() if name not in still})
