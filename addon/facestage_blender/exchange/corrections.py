"""What the user has changed of an imported performance: keys that are not where the film was."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector

from facestage.contract.arrays import Float
from facestage.contract.corrections import Correction, joined
from facestage.contract.errors import InputError
from facestage.contract.sequence import Sequence

from ..rig.face_rig import key_name, require_rig, rig_axes
from ..rig.keyframes import curves_of
from ..rig.sliders import carrier, slider_path
from ..scene import frames
from ..scene.paths import absolute
from .performance import (
    PLACE,
    TURN,
    Simplicity,
    frame_times,
    head_frame,
    head_keys,
    key_frames,
    keyframe_of,
    mark_of,
    remember,
)

# How far a key may be from where it was put, for what Blender keeps of a number: of a weight; of a
# place in metres and a turn in radians; of a frame.
WEIGHT_SAME, PLACE_SAME, FRAME_SAME = 1e-4, 1e-5, 0.02


@dataclass(frozen=True, eq=False)
class Corrected:
    """A performance, and what was changed of it by hand."""

    sequence: Sequence
    corrections: tuple[Correction, ...]


def corrected_performance(scene: bpy.types.Scene) -> Corrected:
    """What the scene's keys say otherwise than the performance that was imported.

    Raises InputError where none was, it is gone or another one by now, or no key says so.
    """
    settings, rig = scene.facestage, require_rig(scene)
    if not settings.performance:
        raise InputError("No performance was imported; press Import Performance first.")
    sequence = Sequence.load(absolute(settings.performance))
    if mark_of(sequence) != settings.performance_mark:
        raise InputError(
            f"The performance '{settings.performance}' was written anew since it was imported; "
            "import it again."
        )
    times = frame_times(sequence, settings.performance_start)
    found = joined((), [*_weights(rig, sequence, times), *_poses(scene, rig, sequence, times)])
    if not found:
        raise InputError(
            "No key differs from the performance as it was imported; correct the sliders or the "
            "head in some frames, and key them."
        )
    return Corrected(sequence, found)


def key_again(scene: bpy.types.Scene, before: Sequence) -> int:
    """Key what a refit has changed of the performance ``before``; returns how many frames."""
    settings, rig = scene.facestage, require_rig(scene)
    sequence = Sequence.load(absolute(settings.performance))
    other = (sequence.expression != before.expression).any(axis=1)
    other |= (sequence.model_to_camera != before.model_to_camera).any(axis=(1, 2))
    changed = np.flatnonzero(other)
    if len(changed):
        times = frame_times(sequence, settings.performance_start)
        by_hand = [each.frame for each in sequence.corrected]
        pinned = np.isin([frame.number for frame in sequence.frames], by_hand)
        simplicity = Simplicity(settings.performance_simplify, pinned)
        reach = slice(changed[0], changed[-1] + 1)
        key_frames(scene, rig, sequence, times, reach, simplicity)
    remember(scene, sequence, settings.performance_start)
    scene.frame_set(scene.frame_current)
    return len(changed)


def film_numbers(sequence: Sequence, start: float, first: int, last: int) -> tuple[int, int]:
    """The film's frames of the scene's ``first`` to ``last``, if the film begins at ``start``.

    Raises InputError where there are none.
    """
    times = frame_times(sequence, start)
    inside = np.flatnonzero((times >= first - 0.5) & (times <= last + 0.5))
    if not len(inside):
        raise InputError(
            f"The performance plays from frame {times[0]:.0f} to {times[-1]:.0f}, not from {first} "
            f"to {last}."
        )
    return sequence.frames[inside[0]].number, sequence.frames[inside[-1]].number


def _weights(
    rig: bpy.types.Object, sequence: Sequence, times: Float[np.ndarray, " frames"]
) -> Iterator[Correction]:
    shapes = rig.data.shape_keys
    curves = {curve.data_path: curve for curve in curves_of(shapes)}
    for name, column in zip(sequence.expression_names, sequence.expression.T, strict=True):
        key = shapes.key_blocks.get(key_name(name))
        curve = None if key is None else curves.get(slider_path(key))
        if curve is None:
            continue
        index, values = _keys(curve, times)
        for place in np.flatnonzero(np.abs(values - column[index]) > WEIGHT_SAME):
            number = sequence.frames[index[place]].number
            yield Correction(number, {name: float(values[place])})


def _poses(
    scene: bpy.types.Scene,
    face: bpy.types.Object,
    sequence: Sequence,
    times: Float[np.ndarray, " frames"],
) -> Iterator[Correction]:
    rig = carrier(face)
    curves = {(curve.data_path, curve.array_index): curve for curve in curves_of(rig)}
    if any((path, axis) not in curves for path in (PLACE, TURN) for axis in range(3)):
        return
    changed: set[int] = set()
    for path, columns in head_keys(scene, face, sequence):
        for axis, column in enumerate(columns.T if path in (PLACE, TURN) else ()):
            index, values = _keys(curves[path, axis], times)
            changed |= set(index[np.abs(values - column[index]) > PLACE_SAME].tolist())
    base, axes = head_frame(scene, face).inverted(), rig_axes(face)
    to_camera = np.linalg.inv(keyframe_of(sequence).camera_to_stage)
    for frame in sorted(changed):
        place, turn = (
            [curves[path, axis].evaluate(times[frame]) for axis in range(3)]
            for path in (PLACE, TURN)
        )
        shown = base @ Matrix.LocRotScale(Vector(place), Euler(turn, "XYZ"), rig.scale)
        pose = to_camera @ frames.to_stage_matrix(np.array(shown), axes)
        yield Correction(sequence.frames[frame].number, {}, _rigid(pose))


def _rigid(pose: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    """The nearest transform without scale."""
    left, _, right = np.linalg.svd(pose[:3, :3])
    result = np.eye(4)
    result[:3, :3], result[:3, 3] = left @ right, pose[:3, 3]
    return result


def _keys(
    curve: bpy.types.FCurve, times: Float[np.ndarray, " frames"]
) -> tuple[np.ndarray, np.ndarray]:
    """Which of the film's frames have keys, and their values."""
    points = np.empty(2 * len(curve.keyframe_points))
    curve.keyframe_points.foreach_get("co", points)
    at, values = points.reshape(-1, 2).T
    nearest = np.abs(at[:, None] - times).argmin(axis=1) if len(at) else np.zeros(0, int)
    there = np.abs(times[nearest] - at) < FRAME_SAME
    return nearest[there], values[there]
