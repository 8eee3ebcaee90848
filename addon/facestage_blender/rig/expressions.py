"""The face's expressions as an artist moves them: by region, to neutral, as fitted, mirrored."""

from __future__ import annotations

import re

import bpy

from . import relief_key
from .face_rig import IDENTITY, move_sliders, slider_values
from .own_record import OwnMesh
from .sliders import rest_handles, set_slider

# ARKit's names begin with their region; what has another name is the face model's own.
REGIONS = {
    "Eyes": ("eye",),
    "Brows": ("brow",),
    "Jaw": ("jaw", "tongue"),
    "Mouth": ("mouth",),
    "Cheeks and Nose": ("cheek", "nose"),
}
FURTHER = "Further"
_PAIRS = {"Left": "Right", "left": "right", "LEFT": "RIGHT", "L": "R", "l": "r"}
_OTHER = _PAIRS | {right: left for left, right in _PAIRS.items()}
# mouthSmileLeft, LeftBlink, lid_left, Smile.L; but not "cleft".
_SIDE = re.compile(r"(?:Left|Right)(?![a-z])|(?<=[_. -])(?:left|right|LEFT|RIGHT|[LlRr])$")


def expression_keys(rig: bpy.types.Object) -> dict[str, list[bpy.types.ShapeKey]]:
    """The rig's expression sliders by region; regions without one are left out."""
    if rig.data.shape_keys is None:
        return {}
    keys = list(rig.data.shape_keys.key_blocks)[1:]
    own = OwnMesh.of(rig)
    if own is None:
        keys = [key for key in keys if not key.name.startswith(IDENTITY)]
    else:
        named = {name for name, _ in own.expression.values()}
        keys = [key for key in keys if key.name in named]
    found: dict[str, list[bpy.types.ShapeKey]] = {name: [] for name in (*REGIONS, FURTHER)}
    for key in keys:
        if key.name != relief_key.NAME:
            found[region_of(key.name)].append(key)
    return {name: keys for name, keys in found.items() if keys}


def region_of(name: str) -> str:
    """The region that an expression's name speaks of."""
    for region, beginnings in REGIONS.items():
        if re.match(rf"(?:{'|'.join(beginnings)})(?![a-z])", name):
            return region
    return FURTHER


def neutral(rig: bpy.types.Object) -> None:
    """Put all expressions to rest."""
    move(rig, {key.name: 0.0 for keys in expression_keys(rig).values() for key in keys})


def as_fitted(rig: bpy.types.Object, expression: dict[str, float]) -> None:
    """Give back a result's expression; the identity stays. Raises InputError for another rig's."""
    values = slider_values(rig, {}, expression)
    rest_handles(rig)
    move_sliders(rig, values)


def mirror(rig: bpy.types.Object) -> None:
    """Exchange left and right."""
    values = {key.name: key.value for keys in expression_keys(rig).values() for key in keys}
    move(rig, {name: values.get(mirrored(name), value) for name, value in values.items()})


def mirrored(name: str) -> str:
    """The name of the same expression on the other side; the name itself where it has none."""
    found = list(_SIDE.finditer(name))
    if not found:
        return name
    side = found[-1]
    return f"{name[: side.start()]}{_OTHER[side[0]]}{name[side.end() :]}"


def move(rig: bpy.types.Object, values: dict[str, float]) -> None:
    """Set sliders, none of them longer than it is; handles of a control rig come to rest."""
    rest_handles(rig)
    for name, value in values.items():
        key = rig.data.shape_keys.key_blocks[name]
        set_slider(key, min(max(value, key.slider_min), key.slider_max))
