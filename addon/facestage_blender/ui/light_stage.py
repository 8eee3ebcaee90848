"""Step 2: the light stage."""

import bpy
from bpy.props import EnumProperty

from ..scene.stage import new_stage, require_stage, stage_lights
from .action import Action
from .sidebar import SidebarPanel


class FACESTAGE_OT_build_stage(Action, bpy.types.Operator):
    """Builds the scene's light stage."""

    bl_idname = "facestage.build_stage"
    bl_label = "Build Light Stage"
    bl_description = (
        "Build the light stage: square area lights on a hemisphere around the face. "
        "Resets the lights that exist"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Build the stage as the scene's settings say."""
        new_stage(context.scene)


class FACESTAGE_OT_light_states(Action, bpy.types.Operator):
    """Set what the fit may do with all lights at once"""

    bl_idname = "facestage.light_states"
    bl_label = "Set All Lights"

    state: EnumProperty(
        name="State",
        description="What the fit does with every light",
        items=[
            ("ON", "All Fitted", "The fit finds the color and power of every light"),
            ("FROZEN", "All Frozen", "Every light keeps its color and power"),
            ("OFF", "All Off", "Every light is dark"),
        ],
    )

    def act(self, context: bpy.types.Context) -> None:
        """Set the state of every light."""
        for light in stage_lights(require_stage(context.scene)):
            light.facestage_light.state = self.state


class FACESTAGE_PT_stage(SidebarPanel, bpy.types.Panel):
    """Step 2: the light stage."""

    bl_label = "2  Light Stage"

    def draw_header(self, _context: bpy.types.Context) -> None:
        """Draw the step's icon."""
        self.layout.label(icon="LIGHT_AREA")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the stage's sizes and its builder."""
        layout, settings = self.layout, context.scene.facestage
        column = layout.column(align=True)
        column.prop(settings, "light_count")
        column.prop(settings, "light_radius")
        column.prop(settings, "light_side")
        layout.prop(settings, "light_color", text="Color")
        built = settings.stage is not None
        layout.operator(
            "facestage.build_stage",
            icon="FILE_REFRESH" if built else "ADD",
            text="Rebuild Light Stage" if built else None,
        )


class FACESTAGE_PT_lights(SidebarPanel, bpy.types.Panel):
    """The stage's lights one by one."""

    bl_label = "Lights"
    bl_parent_id = "FACESTAGE_PT_stage"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only when there is a stage."""
        return context.scene.facestage.stage is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw state, color and power of each light."""
        layout = self.layout
        layout.operator_menu_enum(
            "facestage.light_states", "state", text="Set All", icon="LIGHT_AREA"
        )
        column = layout.column(align=True)
        for light in stage_lights(context.scene.facestage.stage):
            row = column.row(align=True)
            row.label(text=f"{light.facestage_light.index + 1}")
            row.prop(light.facestage_light, "state", text="", icon_only=True)
            values = row.row(align=True)
            values.active = light.facestage_light.state != "OFF"
            values.prop(light.data, "color", text="")
            values.prop(light.data, "energy", text="")


CLASSES = (
    FACESTAGE_OT_build_stage,
    FACESTAGE_OT_light_states,
    FACESTAGE_PT_stage,
    FACESTAGE_PT_lights,
)
