"""Several faces in one scene: the list above the steps, which are about the one that is shown."""

import bpy
from bpy.props import IntProperty

from ..exchange.faces import add_face, face_name, remove_face, show_face
from ..landmarks.photo_view import look_through_camera
from ..preview import live
from .action import Action


class _OneAtATime(Action):
    """Mixin: what the panel is about does not change under a task, pins or a preview."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Not while the backend works for the face that is shown, or it is pinned."""
        cls.poll_message_set(  # type: ignore[attr-defined]
            "Facestage works for the face that is shown; wait, or end the pinning first"
        )
        return not (context.window_manager.facestage.task or context.scene.facestage.pinning)


class FACESTAGE_OT_add_face(_OneAtATime, bpy.types.Operator):
    """Begins another face."""

    bl_idname = "facestage.add_face"
    bl_label = "Add Face"
    bl_description = (
        "Begin another person's face in this scene, with a rig, a light stage and results of its "
        "own: somebody else in the same photo, or in another photo that you choose then"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Begin it, and show it."""
        live.stop()
        add_face(context.scene)


class FACESTAGE_OT_show_face(_OneAtATime, bpy.types.Operator):
    """Let the panel be about this face"""

    bl_idname = "facestage.show_face"
    bl_label = "Show Face"

    number: IntProperty(name="Face", description="1 is the first of the list", default=1, min=1)

    def act(self, context: bpy.types.Context) -> None:
        """Show it."""
        live.stop()
        show_face(context.scene, self.number)
        if context.scene.facestage.photo:
            look_through_camera(context)


class FACESTAGE_OT_remove_face(_OneAtATime, bpy.types.Operator):
    """Take this face out of the scene, with its light stage; its files stay where they are"""

    bl_idname = "facestage.remove_face"
    bl_label = "Remove Face"

    number: IntProperty(name="Face", description="1 is the first of the list", default=1, min=1)

    def act(self, context: bpy.types.Context) -> None:
        """Remove it."""
        live.stop()
        remove_face(context.scene, self.number)


def draw_faces(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The faces of the scene, the one that is shown pressed; nothing where there is one."""
    settings = context.scene.facestage
    column = layout.column(align=True)
    for number, face in enumerate(settings.faces, 1):
        shown = number == settings.face_shown
        row = column.row(align=True)
        # Of the one that is shown the list is a moment behind.
        name = face_name(settings if shown else face, number)
        row.operator("facestage.show_face", text=name, icon="USER", depress=shown).number = number
        row.operator("facestage.remove_face", text="", icon="X").number = number


CLASSES = (FACESTAGE_OT_add_face, FACESTAGE_OT_show_face, FACESTAGE_OT_remove_face)
