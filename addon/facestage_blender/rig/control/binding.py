"""Sliders and handles: each slider's shape key shows the slider and what the handles add to it.

The drivers are what Blender calls simple expressions: it evaluates them itself, in files whose
scripts nobody trusts, too.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import bpy

from ..keyframes import curves_of, own_actions
from ..sliders import is_bound, set_slider, show_range, slider_path, value_path
from .handles import TARGETS, Drive, Handle
from .places import Place, way_of

_SWING = "SWING_TWIST_Y"  # the eyes: where they look, however they roll
_SUMMAND = re.compile(r"([-+.e\d]+)\*max\(0,(-?)(h\d+)\)")


@dataclass(frozen=True)
class Term:
    """What a direction of a handle adds to a slider."""

    slider: str
    bone: str
    turn: bool
    axis: int
    sign: int
    slope: float  # of the slider, over the handle's way in mesh units or radians


def bind(
    rig: bpy.types.Object,
    armature: bpy.types.Object,
    handles: Sequence[Handle],
    places: Mapping[str, Place],
    full: Mapping[str, float],
    unit: float,
) -> None:
    """Drive the sliders of the handles; their values and keys stay.

    ``full``: the value that is all of a slider; ``unit``: mesh units a metre.
    """
    shapes = rig.data.shape_keys
    terms: dict[str, list[tuple[str, Drive, float]]] = {}
    for handle in handles:
        for drive in handle.drives:
            way = places[handle.name].ways[way_of(drive)] * (1.0 if drive.turn else unit)
            slope = drive.gain * full[drive.slider] / way
            terms.setdefault(drive.slider, []).append((handle.name, drive, slope))
    fresh = {}
    for name, adds in terms.items():
        key = shapes.key_blocks[name]
        if not is_bound(key):
            fresh[value_path(key)] = name
            shapes[name] = float(key.value)
            show_range(key)
        _drive(key, armature, adds)
    own_actions(shapes)
    for curve in curves_of(shapes):
        if curve.data_path in fresh:
            curve.data_path = slider_path(shapes.key_blocks[fresh[curve.data_path]])


def unbind(rig: bpy.types.Object) -> None:
    """Give the shape keys their own values back, as they are shown, and the sliders' keys."""
    shapes = rig.data.shape_keys
    if shapes is None:
        return
    bound = [key for key in shapes.key_blocks if is_bound(key)]
    paths = {slider_path(key): value_path(key) for key in bound}
    own_actions(shapes)
    for key in bound:
        shown = key.value
        key.driver_remove("value")
        del shapes[key.name]
        set_slider(key, shown)
    for curve in curves_of(shapes):
        if curve.data_path in paths:
            curve.data_path = paths[curve.data_path]


def read_terms(rig: bpy.types.Object) -> list[Term]:
    """What the handles add to the sliders, as the drivers have it."""
    found, shapes = [], rig.data.shape_keys
    for name, driver in ((each.name, _driver(each)) for each in shapes.key_blocks):
        if driver is None:
            continue
        bones = {each.name: each.targets[0] for each in driver.variables}
        for slope, minus, variable in _SUMMAND.findall(driver.expression):
            if variable in bones:
                kind, axis = bones[variable].transform_type.split("_")
                turn, sign = kind == "ROT", -1 if minus else 1
                bone = bones[variable].bone_target
                found.append(Term(name, bone, turn, "XYZ".index(axis), sign, float(slope)))
    return found


def _driver(key: bpy.types.ShapeKey) -> bpy.types.Driver | None:
    """The driver of a bound slider."""
    data = key.id_data.animation_data
    curve = data.drivers.find(value_path(key)) if is_bound(key) and data is not None else None
    return None if curve is None else curve.driver


def _drive(
    key: bpy.types.ShapeKey, armature: bpy.types.Object, adds: Sequence[tuple[str, Drive, float]]
) -> None:
    """Let a shape key be its slider and what handles add."""
    key.driver_remove("value")
    driver = key.driver_add("value").driver
    driver.type = "SCRIPTED"
    slider = driver.variables.new()
    slider.name, slider.type = "s", "SINGLE_PROP"
    slider.targets[0].id_type = "KEY"
    slider.targets[0].id = key.id_data
    slider.targets[0].data_path = slider_path(key)
    words = ["s"]
    for place, (bone, drive, slope) in enumerate(adds):
        variable = driver.variables.new()
        variable.name, variable.type = f"h{place}", "TRANSFORMS"
        target = variable.targets[0]
        target.id, target.bone_target = armature, bone
        target.transform_type = ("ROT_" if drive.turn else "LOC_") + "XYZ"[drive.axis]
        target.transform_space = "LOCAL_SPACE"
        target.rotation_mode = _SWING if bone in TARGETS else "XYZ"
        words.append(f"{slope:.9g}*max(0,{'-' if drive.sign < 0 else ''}h{place})")
    driver.expression = "+".join(words)
