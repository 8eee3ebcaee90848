"""Step 2: the light stage."""

import bpy
from bpy.props import EnumProperty

from facestage.contract.errors import InputError

from ..drawing import draw_wrapped
from ..scene.obstacles import clear, cleared, give_back, obstacles, world_shines
from ..scene.stage import new_stage, require_stage, stage_lights
from ..scene.surroundings import light_as_world
from ..translations import FACESTAGE, said
from .action import Action
from .sidebar import SidebarPanel, line_width
from .white_balance import draw_white_balance

LOOKED_AT = 500  # objects: more would make the panel slow to draw
NAMED = 3


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


class FACESTAGE_OT_light_as_world(Action, bpy.types.Operator):
    """Lights the stage as the world's picture does."""

    bl_idname = "facestage.light_as_world"
    bl_label = "Light as World"
    bl_description = (
        "The surroundings are known: put frozen lights where the world's Environment Texture is "
        "bright, in place of the stage's. Turn it about Z so that the photo's camera looks along "
        "the stage's; the fit finds the exposure"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Put the lights there, and say what is to be done about the world's own."""
        light_as_world(context.scene)
        count = len(stage_lights(require_stage(context.scene)))
        twice = (
            "; the world lights the face as well until you press Hide What Is in the Way"
            if world_shines(context.scene)
            else ""
        )
        self.report({"INFO"}, f"{count} lights stand for the world's picture{twice}.")


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


class FACESTAGE_OT_clear_stage(Action, bpy.types.Operator):
    """Hides what would stand between the lights and the face."""

    bl_idname = "facestage.clear_stage"
    bl_label = "Hide What Is in the Way"
    bl_description = (
        "Hide the objects that stand where the face or its lights are, turn other lights off and "
        "the world dark. Give Back undoes it"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Hide it, and say what that was."""
        names = clear(context.scene)
        self.report({"INFO"}, f"Hidden: {', '.join(names)}." if names else "Nothing is in the way.")


class FACESTAGE_OT_give_back(Action, bpy.types.Operator):
    """Show again what was put out of the way, with the world's light"""

    bl_idname = "facestage.give_back"
    bl_label = "Give Back"

    def act(self, context: bpy.types.Context) -> None:
        """Show it."""
        give_back(context.scene)


class FACESTAGE_PT_stage(SidebarPanel, bpy.types.Panel):
    """Step 2: the light stage."""

    bl_label = "2  Light Stage"

    def draw_header(self, _context: bpy.types.Context) -> None:
        """Draw the step's icon."""
        self.layout.label(icon="LIGHT_AREA")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the stage's builder, and what else lights or hides the face."""
        layout, settings = self.layout, context.scene.facestage
        built = settings.stage is not None
        layout.operator(
            "facestage.build_stage",
            icon="FILE_REFRESH" if built else "ADD",
            text="Rebuild Light Stage" if built else None,
        )
        if built:
            layout.operator("facestage.light_as_world", icon="WORLD")
            _draw_obstacles(layout, context)


def _draw_obstacles(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Name what hides or lights the face beside the stage, and the button against it."""
    names, scene = [], context.scene
    if len(scene.objects) <= LOOKED_AT:
        try:
            names = [item.name for item in obstacles(scene)]
        except InputError:  # the operators say what is wrong with the stage
            return
    if world_shines(scene):
        names.append(said("the world's light"))
    if names:
        more = f" and {len(names) - NAMED} more" if len(names) > NAMED else ""
        sentence = said("In the way: {names}", names=f"{', '.join(names[:NAMED])}{more}")
        draw_wrapped(layout, sentence, "ERROR", line_width(context))
    column = layout.column(align=True)
    if names or len(scene.objects) > LOOKED_AT:
        column.operator("facestage.clear_stage", icon="HIDE_ON")
    if cleared(scene):
        column.operator("facestage.give_back", icon="LOOP_BACK")


class FACESTAGE_PT_stage_options(SidebarPanel, bpy.types.Panel):
    """How the stage is built, and what the fit may do with its light."""

    bl_label = "Options"
    bl_parent_id = "FACESTAGE_PT_stage"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the stage's sizes, and the light's colors and directions."""
        layout, settings = self.layout, context.scene.facestage
        layout.use_property_split, layout.use_property_decorate = True, False
        column = layout.column(align=True)
        column.prop(settings, "light_count")
        column.prop(settings, "light_radius")
        column.prop(settings, "light_side")
        column = layout.column(align=True)
        column.prop(settings, "light_color")
        column.prop(settings, "surround")
        layout.use_property_split = False
        draw_white_balance(layout, settings)


class FACESTAGE_PT_lights(SidebarPanel, bpy.types.Panel):
    """The stage's lights one by one."""

    bl_label = "Lights"
    bl_translation_context = FACESTAGE
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
            numbered = column.split(factor=0.12, align=True)
            numbered.label(text=f"{light.facestage_light.index + 1}")
            row = numbered.row(align=True)
            row.prop(light.facestage_light, "state", text="", icon_only=True)
            values = row.split(factor=0.35, align=True)
            values.active = light.facestage_light.state != "OFF"
            values.prop(light.data, "color", text="")
            values.prop(light.data, "energy", text="")


CLASSES = (
    FACESTAGE_OT_build_stage,
    FACESTAGE_OT_light_as_world,
    FACESTAGE_OT_light_states,
    FACESTAGE_OT_clear_stage,
    FACESTAGE_OT_give_back,
    FACESTAGE_PT_stage,
    FACESTAGE_PT_stage_options,
    FACESTAGE_PT_lights,
)
