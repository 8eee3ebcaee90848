"""Keyframes of many sliders, written at once."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise

import bpy
import numpy as np

from facestage.contract.arrays import Bool, Float, Int

from .sliders import control_rig, key_slider, slider_path, widen

SAME = 1e-3  # frames


@dataclass(frozen=True, eq=False)
class Thinning:
    """Which keys may be left out: those without which a curve stays within ``tolerance`` of all;
    never those that are ``pinned``.
    """

    tolerance: float
    pinned: Bool[np.ndarray, " keys"] | None = None

    def kept(
        self, frames: Float[np.ndarray, " keys"], values: Float[np.ndarray, " keys"]
    ) -> Int[np.ndarray, " kept"]:
        """The first, the last, the pinned, and always the one that a straight line between its
        neighbours misses most (Douglas and Peucker 1973).
        """
        if self.tolerance <= 0:
            return np.arange(len(frames))
        pinned = np.zeros(0, int) if self.pinned is None else np.flatnonzero(self.pinned)
        kept = {0, len(frames) - 1, *pinned.tolist()}
        waiting = list(pairwise(sorted(kept)))
        while waiting:
            first, last = waiting.pop()
            if last - first < 2:
                continue
            ends, between = [first, last], slice(first + 1, last)
            line = np.interp(frames[between], frames[ends], values[ends])
            missed = np.abs(values[between] - line)
            worst = int(missed.argmax())
            if missed[worst] > self.tolerance:
                middle = first + 1 + worst
                kept.add(middle)
                waiting += [(first, middle), (middle, last)]
        return np.array(sorted(kept))


def key_now(keys: Iterable[bpy.types.ShapeKey], frame: float) -> None:
    """Key sliders as they are."""
    for key in keys:
        key_slider(key, frame)


def key_handles(rig: bpy.types.Object, frame: float) -> None:
    """Key the handles of the face's control rig, if it has one, as they are, head and neck, too."""
    armature = control_rig(rig)
    for bone in () if armature is None else armature.pose.bones:
        for path, locks in (
            ("location", bone.lock_location),
            ("rotation_euler", bone.lock_rotation),
        ):
            for axis in (axis for axis in range(3) if not locks[axis]):
                bone.keyframe_insert(path, index=axis, frame=frame)


def write_keys(
    rig: bpy.types.Object,
    frames: Float[np.ndarray, " keys"],
    weights: Mapping[str, Float[np.ndarray, " keys"]],
    thinning: Thinning | None = None,
) -> None:
    """Key sliders of the rig at ``frames``, which grow; what they had from the first to the last of
    these is replaced. ``thinning``: which keys may be left out.
    """
    shapes = rig.data.shape_keys
    for name, values in weights.items():
        key = shapes.key_blocks[name]
        widen(key, float(values.min()), float(values.max()))
        key_slider(key, float(frames[0]))  # makes action, slot and curve
        write_curve(shapes, slider_path(key), 0, frames, values, thinning)


def write_curve(
    owner: bpy.types.ID,
    path: str,
    index: int,
    frames: Float[np.ndarray, " keys"],
    values: Float[np.ndarray, " keys"],
    thinning: Thinning | None = None,
) -> None:
    """Key what has a key already, in straight lines; what it had meanwhile is replaced.

    ``thinning``: which keys may be left out. The whole curve is written at once: key by key an hour
    of video would take minutes.
    """
    action = owner.animation_data.action
    if hasattr(action, "fcurve_ensure_for_datablock"):  # Blender 5.0
        curve = action.fcurve_ensure_for_datablock(owner, path, index=index)
    else:
        curve = action.fcurves.find(path, index=index)
    points = curve.keyframe_points
    old = np.empty(2 * len(points))
    points.foreach_get("co", old)
    old = old.reshape(-1, 2)
    kept = old[(old[:, 0] < frames[0] - SAME) | (old[:, 0] > frames[-1] + SAME)]
    chosen = slice(None) if thinning is None else thinning.kept(frames, values)
    table = np.concatenate([kept, np.stack([frames[chosen], values[chosen]], 1)])
    table = table[np.argsort(table[:, 0], kind="stable")]
    points.clear()
    points.add(len(table))
    points.foreach_set("co", table.ravel().astype(np.float32))
    kinds = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items
    points.foreach_set("interpolation", np.full(len(table), kinds["LINEAR"].value, np.int32))
    curve.update()


def curves_of(owner: bpy.types.ID) -> Iterator[bpy.types.FCurve]:
    """The curves that animate ``owner``: those of its action and of its strips."""
    for curves in _collections(owner):
        yield from curves


def remove_curves(owner: bpy.types.ID, paths: Collection[str]) -> None:
    """Take away the curves of these paths."""
    for curves in _collections(owner):
        for curve in [curve for curve in curves if curve.data_path in paths]:
            curves.remove(curve)


def own_actions(owner: bpy.types.ID) -> None:
    """Give ``owner`` a copy of each of its actions that others use, before its curves change."""
    for user in _users(owner):
        if user.action.users - user.action.use_fake_user > 1:
            slot = getattr(user, "action_slot", None)
            user.action = user.action.copy()
            if slot is not None:
                user.action_slot = user.action.slots[slot.identifier]


def _users(owner: bpy.types.ID) -> Iterator[bpy.types.AnimData | bpy.types.NlaStrip]:
    data = owner.animation_data
    if data is None:
        return
    strips = (strip for track in data.nla_tracks for strip in track.strips)
    yield from (user for user in (data, *strips) if user.action is not None)


def _collections(owner: bpy.types.ID) -> Iterator[bpy.types.ActionFCurves]:
    """The collections of curves that belong to ``owner``, in each of its actions."""
    for user in _users(owner):
        action, slot = user.action, getattr(user, "action_slot", None)
        if slot is None:  # before Blender 4.4
            yield action.fcurves
            continue
        for layer in action.layers:
            for strip in layer.strips:
                bag = strip.channelbag(slot)
                if bag is not None:
                    yield bag.fcurves
