"""A slider of the face: a shape key's own value or, with a control rig, what the handles add to.

With a control rig a driver sets the shape key: the slider, which is then a custom property of the
shape keys under the shape key's name, and what the handles say on top. Keys of a slider stay in
the same action under another path, so that keys and handles never overwrite each other.
"""

from __future__ import annotations

import bpy
from mathutils import Matrix

WHOLE = ("head", "neck")  # bones that move the face as a whole
LIMIT = 10.0  # Blender's own of a shape key


def control_rig(rig: bpy.types.Object) -> bpy.types.Object | None:
    """The armature of the face's handles, or None; one that was deleted is none."""
    armature: bpy.types.Object | None = rig.facestage_face.control_rig
    return armature if armature is not None and armature.users_scene else None


def carrier(rig: bpy.types.Object) -> bpy.types.Object:
    """What is moved when the face is: its control rig, or itself."""
    return control_rig(rig) or rig


def is_bound(key: bpy.types.ShapeKey) -> bool:
    """Whether handles add to this slider."""
    return key.name in key.id_data


def slider_path(key: bpy.types.ShapeKey) -> str:
    """Where the slider is, from the shape keys on."""
    if is_bound(key):
        return f'["{bpy.utils.escape_identifier(key.name)}"]'
    return value_path(key)


def value_path(key: bpy.types.ShapeKey) -> str:
    """Where the shape key's own value is, from the shape keys on."""
    return f'key_blocks["{bpy.utils.escape_identifier(key.name)}"].value'


def widen(key: bpy.types.ShapeKey, low: float, high: float) -> None:
    """Make a slider as long as values from ``low`` to ``high`` need."""
    key.slider_min, key.slider_max = min(key.slider_min, low), max(key.slider_max, high)
    if is_bound(key):
        show_range(key)


def show_range(key: bpy.types.ShapeKey) -> None:
    """Let a bound slider look as long as its shape key's is."""
    key.id_data.id_properties_ui(key.name).update(
        min=-LIMIT,
        max=LIMIT,
        soft_min=key.slider_min,
        soft_max=key.slider_max,
        default=0.0,
        description=f"{key.name}: the handles of the control rig add to it",
    )


def set_slider(key: bpy.types.ShapeKey, value: float) -> None:
    """Move a slider; the shape key shows it at once where the handles are at rest."""
    if is_bound(key):
        key.id_data[key.name] = float(value)
        key.id_data.update_tag()
    key.value = value


def key_slider(key: bpy.types.ShapeKey, frame: float) -> None:
    """Key a slider as it is."""
    key.id_data.keyframe_insert(slider_path(key), frame=frame)


def draw_slider(layout: bpy.types.UILayout, key: bpy.types.ShapeKey) -> None:
    """Draw a slider under its shape key's name."""
    owner, path = (key.id_data, slider_path(key)) if is_bound(key) else (key, "value")
    layout.prop(owner, path, text=key.name, slider=True)


def rest_handles(rig: bpy.types.Object, whole: bool = False) -> None:
    """Put the handles of the face's control rig, if it has one, where they add nothing.

    ``whole``: head and neck, too, which say nothing of the expression.
    """
    armature = control_rig(rig)
    if armature is None:
        return
    for bone in armature.pose.bones:
        if whole or bone.name not in WHOLE:
            bone.matrix_basis = Matrix()
