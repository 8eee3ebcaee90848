"""Keyframes of many sliders, written at once."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import bpy
import numpy as np

from facestage.contract.arrays import Float

SAME = 1e-3  # frames


def key_now(keys: Iterable[bpy.types.ShapeKey], frame: float) -> None:
    """Key sliders as they are."""
    for key in keys:
        key.keyframe_insert("value", frame=frame)


def write_keys(
    rig: bpy.types.Object,
    frames: Float[np.ndarray, " keys"],
    weights: Mapping[str, Float[np.ndarray, " keys"]],
) -> None:
    """Key sliders of the rig at ``frames``, which grow; what they had from the first to the last of
    these is replaced.
    """
    shapes = rig.data.shape_keys
    for name, values in weights.items():
        key = shapes.key_blocks[name]
        key.slider_min = min(key.slider_min, float(values.min()))
        key.slider_max = max(key.slider_max, float(values.max()))
        key.keyframe_insert("value", frame=float(frames[0]))  # makes action, slot and curve
        path = f'key_blocks["{bpy.utils.escape_identifier(name)}"].value'
        write_curve(shapes, path, 0, frames, values)


def write_curve(
    owner: bpy.types.ID,
    path: str,
    index: int,
    frames: Float[np.ndarray, " keys"],
    values: Float[np.ndarray, " keys"],
) -> None:
    """Key what has a key already, in straight lines; what it had meanwhile is replaced.

    The whole curve is written at once: key by key an hour of video would take minutes.
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
    table = np.concatenate([kept, np.stack([frames, values], 1)])
    table = table[np.argsort(table[:, 0], kind="stable")]
    points.clear()
    points.add(len(table))
    points.foreach_set("co", table.ravel().astype(np.float32))
    kinds = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items
    points.foreach_set("interpolation", np.full(len(table), kinds["LINEAR"].value, np.int32))
    curve.update()
