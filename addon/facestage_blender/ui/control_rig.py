"""Step 5: handles for animators, below the expressions."""

import bpy

from ..rig.control.baking import bake_to_handles
from ..rig.control.control_rig import add_control_rig, remove_control_rig
from ..rig.sliders import control_rig
from .action import Action
from .sidebar import SidebarPanel


class FACESTAGE_OT_add_control_rig(Action, bpy.types.Operator):
    """Gives the face handles."""

    bl_idname = "facestage.add_control_rig"
    bl_label = "Add Control Rig"
    bl_description = (
        "Give the face an armature with handles for head, jaw, eyes, brows, lids, cheeks and "
        "mouth, which add to its sliders. Where it has one, put the handles where the skin is now"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Build it."""
        add_control_rig(context.scene)


class FACESTAGE_OT_remove_control_rig(Action, bpy.types.Operator):
    """Takes the handles away."""

    bl_idname = "facestage.remove_control_rig"
    bl_label = "Remove Control Rig"
    bl_description = (
        "Take the handles away, with their keys. The face stays as it is shown, and its sliders "
        "keep their keys"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Remove it."""
        remove_control_rig(context.scene)


class FACESTAGE_OT_bake_to_rig(Action, bpy.types.Operator):
    """Moves the expression onto the handles."""

    bl_idname = "facestage.bake_to_rig"
    bl_label = "Bake to Rig"
    bl_description = (
        "Move what the sliders say onto the handles: the present expression, or all keys of the "
        "sliders. What no handle can say stays on its slider; the face does not change"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Bake."""
        frames = bake_to_handles(context.scene)
        if frames:
            self.report({"INFO"}, f"{frames} frames are keyed on the handles.")


class FACESTAGE_PT_control_rig(SidebarPanel, bpy.types.Panel):
    """The face's handles."""

    bl_label = "Control Rig"
    bl_parent_id = "FACESTAGE_PT_expressions"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what makes handles, and what can be done with them."""
        layout, rig = self.layout, context.scene.facestage.rig
        armature = None if rig is None else control_rig(rig)
        if armature is None:
            layout.operator("facestage.add_control_rig", icon="ARMATURE_DATA")
            return
        layout.operator("facestage.bake_to_rig", icon="POSE_HLT")
        column = layout.column(align=True)
        for collection in armature.data.collections:
            column.prop(collection, "is_visible", text=collection.name, toggle=True)
        row = layout.row(align=True)
        row.operator("facestage.add_control_rig", text="Fit to Face", icon="FILE_REFRESH")
        row.operator("facestage.remove_control_rig", text="Remove", icon="X")


CLASSES = (
    FACESTAGE_OT_add_control_rig,
    FACESTAGE_OT_remove_control_rig,
    FACESTAGE_OT_bake_to_rig,
    FACESTAGE_PT_control_rig,
)
