"""The control rig's armature: bones where the handles stand, their limits and looks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import bpy
import numpy as np
from mathutils import Matrix, Vector

from facestage.contract.errors import InputError

from .handles import HEAD, JAW, TARGET, TARGETS, Handle
from .places import Place
from .widgets import widget

# Names of constraints.
LIMIT, LIMIT_TURN, LOOK_AT, FOLLOW = "Limit", "Limit Turn", "Look At", "Follow Head"
SMALL, MIDDLE = 0.0035, 0.006  # metres that handles are drawn with
PALETTES = {1: "THEME01", -1: "THEME04", 0: "THEME09"}  # left, right, middle
# Bones that move no slider themselves: what they are drawn as, with what radius in metres
# (None: half the width of the face), and their parents.
FIXED: dict[str, tuple[str, float | None, str]] = {
    "neck": ("hoop", None, ""),
    "head": ("hoop", None, "neck"),
    TARGET: ("frame", 0.012, ""),
    **dict.fromkeys(TARGETS.values(), ("ring", 0.01, TARGET)),
}
AXES = "xyz"


def shape_bones(
    armature: bpy.types.Object,
    handles: Sequence[Handle],
    places: Mapping[str, Place],
    to_mesh: np.ndarray,
) -> None:
    """Give the armature these bones at these places, and no others; ``to_mesh`` (4, 4) from the
    model frame. Raises InputError where the armature is not to be edited.
    """
    layer = bpy.context.view_layer
    if layer.objects.get(armature.name) is None:
        layer.update()  # until then it does not list what was made just now
    if layer.objects.get(armature.name) is None or armature.library is not None:
        raise InputError(
            f"'{armature.name}' is in no collection that is shown; show the collection of the face."
        )
    armature.hide_set(False)
    armature.hide_viewport = False
    layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        _edit(armature.data.edit_bones, handles, places, to_mesh)
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def _edit(
    bones: bpy.types.ArmatureEditBones,
    handles: Sequence[Handle],
    places: Mapping[str, Place],
    to_mesh: np.ndarray,
) -> None:
    parents = {name: FIXED[name][2] for name in places if name in FIXED}
    parents |= {each.name: each.parent for each in handles}
    for bone in [bone for bone in bones if bone.name not in places]:
        bones.remove(bone)
    for name, place in places.items():
        bone = bones.get(name) or bones.new(name)
        bone.head, bone.tail = (_moved(to_mesh, point) for point in (place.head, place.tail))
        bone.align_roll(Vector(to_mesh[:3, :3] @ place.front))
        bone.use_connect = bone.use_deform = False
    for name in places:
        bones[name].parent = bones.get(parents[name])


def dress(
    armature: bpy.types.Object,
    handles: Sequence[Handle],
    places: Mapping[str, Place],
    to_mesh: np.ndarray,
    half_width: float,
) -> None:
    """Give the bones their limits, targets, shapes, colors and collections. ``half_width``: of the
    face, metres.
    """
    unit = float(np.cbrt(abs(np.linalg.det(to_mesh[:3, :3]))))  # mesh units a metre
    bones = armature.pose.bones
    for bone in bones:
        bone.rotation_mode = "XYZ"
        for constraint in list(bone.constraints):
            if constraint.name in (LIMIT, LIMIT_TURN, LOOK_AT, FOLLOW):
                bone.constraints.remove(constraint)
        _draw(bone, _look(bone.name, half_width), places[bone.name], to_mesh, unit)
    for handle in handles:
        if handle.name not in TARGETS:
            _limit(bones[handle.name], places[handle.name], unit)
    bones["neck"].lock_location = (True, True, True)
    for name in ("neck", "head"):
        bones[name].lock_scale = (True, True, True)
    _aim(armature)
    _collect(armature.data, {each.name: each.group for each in handles})


def _look(name: str, half_width: float) -> tuple[str, float]:
    """The shape and radius, in metres, of a bone."""
    if name in FIXED:
        shape, radius, _ = FIXED[name]
        return shape, radius or half_width * (0.7 if name == "neck" else 0.9)
    if name == JAW.name:
        return "chin", 0.3 * half_width
    if name in TARGETS:
        return "hoop", MIDDLE
    return ("diamond" if name in ("mouth", "tongue") else "ring"), (
        MIDDLE if name in ("mouth", "tongue", "lips.L", "lips.R") else SMALL
    )


def _draw(
    bone: bpy.types.PoseBone,
    look: tuple[str, float],
    place: Place,
    to_mesh: np.ndarray,
    unit: float,
) -> None:
    shape, radius = look
    bone.custom_shape, bone.use_custom_shape_bone_size = widget(shape), False
    bone.custom_shape_scale_xyz = (radius * unit,) * 3
    mark = Vector(_moved(to_mesh, place.mark))
    bone.custom_shape_translation = bone.bone.matrix_local.inverted() @ mark
    side = 1 if bone.name.endswith(".L") or ".L." in bone.name else 0
    side = -1 if bone.name.endswith(".R") or ".R." in bone.name else side
    bone.bone.color.palette = PALETTES[side]


def _limit(bone: bpy.types.PoseBone, place: Place, unit: float) -> None:
    """Let a handle go where it moves sliders, and as far."""
    ends = {turn: np.zeros((3, 2)) for turn in (False, True)}
    for (turn, axis, sign), way in place.ways.items():
        ends[turn][axis, (sign + 1) // 2] = sign * way * (1.0 if turn else unit)
    held = {turn: [not any(each) for each in both.tolist()] for turn, both in ends.items()}
    bone.lock_location, bone.lock_rotation = held[False], held[True]
    bone.lock_scale = (True, True, True)
    _keep(bone, LIMIT, "LIMIT_LOCATION", ("use_min", "use_max"), ends[False])
    if not all(held[True]):
        _keep(bone, LIMIT_TURN, "LIMIT_ROTATION", ("use_limit",), ends[True])


def _keep(
    bone: bpy.types.PoseBone, name: str, kind: str, uses: Sequence[str], ends: np.ndarray
) -> None:
    """Keep a handle between ``ends`` (3, 2) of its own axes, its tools, too."""
    limit = bone.constraints.new(kind)
    limit.name, limit.owner_space, limit.use_transform_limit = name, "LOCAL", True
    for axis, (low, high) in zip(AXES, ends.tolist(), strict=True):
        for use in uses:
            setattr(limit, f"{use}_{axis}", True)
        setattr(limit, f"min_{axis}", low)
        setattr(limit, f"max_{axis}", high)


def _aim(armature: bpy.types.Object) -> None:
    """Let the eyes look at their targets, and these follow the head as far as wanted."""
    bones = armature.pose.bones
    for name, target in TARGETS.items():
        if name in bones:
            look = bones[name].constraints.new("DAMPED_TRACK")
            look.name, look.target, look.subtarget = LOOK_AT, armature, target
            look.track_axis = "TRACK_Y"
    for name in (TARGET, *TARGETS.values()):
        if name in bones:
            bones[name].lock_scale = (True, True, True)
    if TARGET in bones:
        follow = bones[TARGET].constraints.new("ARMATURE")
        follow.name = FOLLOW
        target = follow.targets.new()
        target.target, target.subtarget = armature, "head"


def _collect(data: bpy.types.Armature, groups: Mapping[str, str]) -> None:
    """Sort the bones into collections."""
    for collection in list(data.collections):
        data.collections.remove(collection)
    for bone in data.bones:
        name = groups.get(bone.name, HEAD)
        name = "Eyes" if bone.name in (TARGET, *TARGETS.values()) else name
        (data.collections.get(name) or data.collections.new(name)).assign(bone)


def hang(rig: bpy.types.Object, armature: bpy.types.Object) -> None:
    """Let the mesh follow the head bone; at rest it lies in the armature's own place."""
    bone = armature.data.bones["head"]
    rig.parent, rig.parent_type, rig.parent_bone = armature, "BONE", bone.name
    end = bone.matrix_local @ Matrix.Translation((0.0, bone.length, 0.0))
    rig.matrix_parent_inverse = end.inverted()
    rig.matrix_basis = Matrix()


def _moved(matrix: np.ndarray, point: np.ndarray) -> list[float]:
    return (matrix[:3, :3] @ point + matrix[:3, 3]).tolist()
