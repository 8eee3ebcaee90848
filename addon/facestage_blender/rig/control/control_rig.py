"""Adds a control rig to the scene's face, keeps it on the face, and takes it away again."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.errors import InputError

from ...scene.several import link_beside
from ...scene.user_state import preserved
from ..face_rig import require_rig
from ..keyframes import curves_of, own_actions, remove_curves
from ..sliders import control_rig, is_bound, rest_handles
from . import armature as bones
from .binding import bind, unbind
from .handles import Handle, handles_for
from .places import Place, places, size
from .reading import expression_names, full_values, mesh_to_model, read_face, rest_points
from .widgets import remove_unused

NAME = "Facestage Rig"
TRANSFORMS = {
    *("location", "scale", "rotation_euler", "rotation_quaternion", "rotation_axis_angle"),
    *("delta_location", "delta_scale", "delta_rotation_euler", "delta_rotation_quaternion"),
}


@dataclass(frozen=True)
class _Plan:
    """Where the bones go."""

    handles: list[Handle]
    places: dict[str, Place]
    size: float  # half the width of the skin, metres
    digest: str  # of the points at rest that this is for


def add_control_rig(scene: bpy.types.Scene) -> bpy.types.Object:
    """Give the scene's face an armature with handles, or put that which it has where the face is.

    Raises InputError for a face without ARKit's expressions, or one whose keys cannot be moved.
    """
    rig = require_rig(scene)
    plan = _plan(rig, _handles(rig), rest_points(rig))
    armature, deleted = control_rig(rig), rig.facestage_face.control_rig
    with preserved(bpy.context.view_layer):
        if armature is None:
            if deleted is not None:
                _take_away(rig, deleted)
            armature = _new(rig)
            try:
                _build(rig, armature, plan)
            except InputError:
                _take_away(rig, armature)
                raise
        else:
            _build(rig, armature, plan)
    return armature


def renewal_steps(scene: bpy.types.Scene) -> Iterator[None]:
    """Put the handles of the scene's face, if it has any, where its skin is by now, at rest: in
    three steps; one where the bones are where they should be.
    """
    rig = scene.facestage.rig
    armature = control_rig(rig) if rig is not None and rig.name in scene.objects else None
    if armature is None:
        return
    rest_handles(rig, whole=True)
    if bpy.context.view_layer.objects.get(armature.name) is None:
        return
    handles, rest = _handles(require_rig(scene)), rest_points(rig)
    keys = rig.data.shape_keys.key_blocks
    bound = all(is_bound(keys[drive.slider]) for each in handles for drive in each.drives)
    if bound and rig.facestage_face.placed_for == _digest(rest):
        return
    yield
    plan = _plan(rig, handles, rest)
    yield
    with preserved(bpy.context.view_layer):
        _build(rig, armature, plan)


def remove_control_rig(scene: bpy.types.Scene) -> None:
    """Take the armature away: the face stays as it is shown, its sliders keep their keys.

    Raises InputError when there is none.
    """
    rig = require_rig(scene)
    armature = rig.facestage_face.control_rig
    if armature is None:
        raise InputError("The face has no control rig; press Add Control Rig first.")
    with preserved(bpy.context.view_layer):
        _take_away(rig, armature)


def _handles(rig: bpy.types.Object) -> list[Handle]:
    handles = [] if rig.data.shape_keys is None else handles_for(expression_names(rig))
    if not handles:
        raise InputError(
            "The face has none of ARKit's expressions (jawOpen, eyeBlinkLeft, ...), which the "
            "handles would move; build a face rig of the default head or of ICT-FaceKit."
        )
    return handles


def _new(rig: bpy.types.Object) -> bpy.types.Object:
    """An armature without bones in the face's place, which it takes over with its keys."""
    data = rig.animation_data
    moved = None if data is None else data.action
    if moved is not None and not {each.data_path for each in curves_of(rig)} <= TRANSFORMS:
        raise InputError(
            f"The action '{moved.name}' moves more of '{rig.name}' than its place; take what is "
            "not location, rotation or scale out of it first."
        )
    if data is not None and data.nla_tracks:
        raise InputError(
            f"'{rig.name}' is moved by NLA tracks; put them into one action or mute and delete "
            "them first."
        )
    armature = bpy.data.objects.new(NAME, bpy.data.armatures.new(NAME))
    armature.show_in_front = True
    link_beside(rig, armature)
    armature.parent, armature.parent_type = rig.parent, rig.parent_type
    armature.parent_bone = rig.parent_bone
    armature.matrix_parent_inverse = rig.matrix_parent_inverse
    armature.rotation_mode = rig.rotation_mode
    armature.matrix_basis = rig.matrix_basis
    _hand_over(rig, armature)
    rig.facestage_face.control_rig = armature
    return armature


def _plan(rig: bpy.types.Object, handles: list[Handle], rest: np.ndarray) -> _Plan:
    face = read_face(rig, rest, {drive.slider for each in handles for drive in each.drives})
    return _Plan(handles, places(face, handles), size(face), _digest(rest))


def _digest(points: np.ndarray) -> str:
    return hashlib.sha256(points.tobytes()).hexdigest()


def _build(rig: bpy.types.Object, armature: bpy.types.Object, plan: _Plan) -> None:
    handles, found = plan.handles, plan.places
    to_mesh = np.linalg.inv(mesh_to_model(rig))
    # The mesh would be shaped anew at every change of the bones.
    hidden = rig.hide_viewport
    rig.hide_viewport = True
    try:
        bones.shape_bones(armature, handles, found, to_mesh)
        bones.dress(armature, handles, found, to_mesh, plan.size)
        unit = float(np.cbrt(abs(np.linalg.det(to_mesh[:3, :3]))))
        bind(rig, armature, handles, found, full_values(rig), unit)
        bones.hang(rig, armature)
    finally:
        rig.hide_viewport = hidden
    rig.facestage_face.placed_for = plan.digest
    bpy.context.view_layer.update()


def _take_away(rig: bpy.types.Object, armature: bpy.types.Object) -> None:
    bpy.context.view_layer.update()
    shown = rig.matrix_world.copy()
    unbind(rig)
    rig.parent, rig.parent_type = armature.parent, armature.parent_type
    rig.parent_bone = armature.parent_bone
    rig.matrix_parent_inverse = armature.matrix_parent_inverse
    rig.rotation_mode = armature.rotation_mode
    rig.matrix_basis = armature.matrix_basis
    own_actions(armature)
    remove_curves(armature, {each.data_path for each in curves_of(armature)} - TRANSFORMS)
    if any(True for _ in curves_of(armature)):
        _hand_over(armature, rig)
    elif not _close(shown, armature.matrix_world):
        rig.matrix_world = shown  # head or neck were turned
    rig.facestage_face.control_rig = None
    data = armature.data
    bpy.data.objects.remove(armature)
    bpy.data.armatures.remove(data)
    remove_unused()
    bpy.context.view_layer.update()


def _hand_over(one: bpy.types.Object, other: bpy.types.Object) -> None:
    """Let ``other`` have the action that moved ``one``."""
    data = one.animation_data
    if data is None or data.action is None:
        return
    action, slot = data.action, getattr(data, "action_slot", None)
    data.action = None
    other.animation_data_create()
    other.animation_data.action = action
    if slot is not None:
        other.animation_data.action_slot = slot


def _close(one: Matrix, other: Matrix) -> bool:
    return bool(np.allclose(np.array(one), np.array(other), atol=1e-6))
