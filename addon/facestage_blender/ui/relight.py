"""Step 5: the result's light: from elsewhere, one light at a time, on the photo, beside it."""

import math
from pathlib import Path
from typing import ClassVar

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from facestage.contract.files.paths import is_file
from facestage.contract.relight_cache import RELIGHT_CACHE
from facestage.contract.result_files import RESULT

from ..backend.commands import render_command
from ..backend.process import BackendProcess
from ..drawing import draw_wrapped
from ..landmarks.empties import shown_plane
from ..preferences import backend_command
from ..preview import live
from ..rig.face_rig import head_yaw
from ..scene.camera import photo_in_front, require_camera
from ..scene.frames import LIGHT_DIRECTIONS
from ..scene.light_setups import LIGHT_FROM, SETUPS
from ..scene.paths import absolute, require_photo, result_folder
from ..scene.picture_light import light_by_world, light_from_picture
from ..scene.relight import light_by_softbox, next_light, relight, restore_lights
from ..scene.softbox import softbox_of
from .action import Action, Toggle
from .backend_task import BackendTask
from .sidebar import draw_task, line_width


class FACESTAGE_OT_relight(Action, bpy.types.Operator):
    """Lights the face otherwise."""

    bl_idname = "facestage.relight"
    bl_label = "Relight"
    bl_description = (
        "Light the face from one side with white light, or as portrait photographers do, or "
        "return to the fitted lights"
    )

    direction: EnumProperty(
        name="From",
        description="Where the light comes from, as seen in the picture",
        items=[("fitted", "As Fitted", "The lights that the fit found")]
        + [(name, setup.label, setup.help) for name, setup in LIGHT_FROM.items()],
    )
    mirrored: BoolProperty(
        name="Mirrored", description="The key comes from the other side of the picture"
    )
    follow_head: BoolProperty(
        name="Follow Head",
        description="Portrait light counts its degrees from where the face looks, not from the "
        "camera. Left, right, top, bottom and front are always the picture's",
        default=True,
    )

    @classmethod
    def description(
        cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties
    ) -> str:
        """The tooltip: what this light does to a face."""
        setup = LIGHT_FROM.get(properties.direction)
        return cls.bl_description if setup is None else setup.help

    def act(self, context: bpy.types.Context) -> None:
        """Change the lights' colors and powers."""
        if self.direction == "fitted":
            restore_lights(context.scene)
        else:
            yaw = head_yaw(context.scene) if self.follow_head else 0.0
            relight(context.scene, self.direction, self.mirrored, yaw)


class FACESTAGE_OT_next_light(Action, bpy.types.Operator):
    """Shows one light alone."""

    bl_idname = "facestage.next_light"
    bl_label = "Next Light"
    bl_description = (
        "Let one light of the stage shine alone, as bright as all together; again: the next one"
    )

    number: IntProperty(
        name="Light",
        description="Which of the lights that are on, 1 is the first; 0: the next one",
        min=0,
        options={"SKIP_SAVE"},
    )

    def act(self, context: bpy.types.Context) -> None:
        """Show it, and say which it is."""
        number, count = next_light(context.scene, self.number)
        self.report({"INFO"}, f"Light {number} of {count} alone.")


class FACESTAGE_OT_light_from_picture(Action, bpy.types.Operator, ImportHelper):
    """Lights the face as a picture of the surroundings would."""

    bl_idname = "facestage.light_from_picture"
    bl_label = "Light From Picture"
    bl_description = (
        "Give the stage's lights the light of a picture of all directions (.exr or .hdr), as well "
        "as they can from where they stand, as bright as the fitted ones"
    )

    filter_glob: StringProperty(default="*.exr;*.hdr", options={"HIDDEN"})
    turn: FloatProperty(
        name="Turn", description="Turns the picture about the vertical", subtype="ANGLE"
    )
    as_world: BoolProperty(
        name="As World",
        description="Let the picture itself light the scene, as its world, and the stage's lights "
        "be dark; As Fitted gives the world back",
    )

    def act(self, context: bpy.types.Context) -> None:
        """Light the stage, and say how well that goes."""
        path, degrees = absolute(self.filepath), math.degrees(self.turn)
        if self.as_world:
            light_by_world(context.scene, path, degrees)
            self.report({"INFO"}, "The world lights the face; the stage's lights are dark.")
            return
        share = light_from_picture(context.scene, path, degrees)
        self.report(
            {"INFO"}, f"The stage's lights give {share:.0%} of the picture's light on the face."
        )


class FACESTAGE_OT_softbox(Action, bpy.types.Operator):
    """Lights the face by a softbox of its own size."""

    bl_idname = "facestage.softbox"
    bl_label = "Softbox"
    bl_description = (
        "Let a white softbox of the size that you give light the face alone, as bright as the "
        "fitted lights. A fit takes it into the stage, as squares"
    )

    width: FloatProperty(
        name="Width", description="Of the softbox", default=0.6, min=0.02, soft_max=3, unit="LENGTH"
    )
    height: FloatProperty(
        name="Height",
        description="Of the softbox",
        default=0.9,
        min=0.02,
        soft_max=3,
        unit="LENGTH",
    )
    distance: FloatProperty(
        name="Distance",
        description="From the face to the softbox",
        default=1.0,
        min=0.2,
        soft_max=5,
        unit="LENGTH",
    )
    left: FloatProperty(
        name="Left",
        description="How far left of the face it stands, as seen in the picture",
        default=math.radians(45),
        min=-math.pi,
        max=math.pi,
        subtype="ANGLE",
    )
    up: FloatProperty(
        name="Above",
        description="How far above the face it stands",
        default=math.radians(30),
        min=-math.pi / 2,
        max=math.pi / 2,
        subtype="ANGLE",
    )
    follow_head: BoolProperty(
        name="Follow Head",
        description="Count the degrees from where the face looks, not from the camera",
        default=True,
    )

    def act(self, context: bpy.types.Context) -> None:
        """Put it there."""
        yaw = head_yaw(context.scene) if self.follow_head else 0.0
        place = (self.left - yaw, self.up, self.distance)
        light_by_softbox(context.scene, place, (self.width, self.height))


class FACESTAGE_MT_light_from(bpy.types.Menu):
    """The lights that have a name."""

    bl_idname = "FACESTAGE_MT_light_from"
    bl_label = "Light From"
    bl_description = "Light the face otherwise than the photo does, or return to the fitted lights"

    def draw(self, _context: bpy.types.Context) -> None:
        """The fitted lights, sides, portrait setups."""
        layout = self.layout
        for names in (("fitted",), LIGHT_DIRECTIONS, SETUPS):
            for name in names:
                label = LIGHT_FROM[name].label if name in LIGHT_FROM else "As Fitted"
                layout.operator("facestage.relight", text=label).direction = name
            layout.separator()
        layout.operator("facestage.softbox", icon="LIGHT_AREA")
        layout.operator("facestage.light_from_picture", text="Picture ...", icon="WORLD")


class FACESTAGE_OT_relight_preview(Toggle, bpy.types.Operator):
    """Turns the live relight preview on and off."""

    bl_idname = "facestage.relight_preview"
    bl_label = "Relight Preview"
    bl_description = (
        "Show the photo relit over the camera's view while you change colors, powers and states "
        "of the lights"
    )
    bl_options: ClassVar[set[str]] = set()

    def is_on(self, _context: bpy.types.Context) -> bool:
        """Whether it is shown."""
        return live.Preview.photo is not None

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Show the preview, or no more."""
        if on:
            live.start(context.scene)
        else:
            live.stop()


class FACESTAGE_OT_prepare_relight(BackendTask, bpy.types.Operator):
    """Have the backend trace the result under each of its lights, then show the relight preview"""

    bl_idname = "facestage.prepare_relight"
    bl_label = "Prepare Relight"

    task = "Tracing each light"

    def command(self, context: bpy.types.Context) -> list[str]:
        """Ask the backend for the result's relight cache."""
        return render_command(backend_command(context), result_folder(context.scene))

    def finish(self, context: bpy.types.Context, _process: BackendProcess) -> None:
        """Show what was made."""
        live.start(context.scene)


class FACESTAGE_OT_before_after(Toggle, bpy.types.Operator):
    """Shows the photo over all that the camera sees, or takes it away again."""

    bl_idname = "facestage.before_after"
    bl_label = "Before / After"
    bl_description = (
        "Show the photo itself over what the camera sees, to compare: with the relit photo while "
        "Relight Preview is on, else with the render (Viewport Shading: Rendered)"
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Not while pins or landmarks want to see the photo."""
        return not context.scene.facestage.pinning and shown_plane(context.scene) is None

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether the photo covers what the camera sees."""
        return photo_in_front(require_camera(context.scene))

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Show the one or the other."""
        require_photo(context.scene)
        live.show_before(require_camera(context.scene), on)


def draw_light(layout: bpy.types.UILayout, context: bpy.types.Context, folder: Path) -> None:
    """Where the light comes from; the live preview's switch, or what makes it possible, and why it
    does not follow the lights.
    """
    row = layout.row(align=True)
    row.menu("FACESTAGE_MT_light_from", icon="LIGHT_SPOT")
    row.operator("facestage.next_light", text="", icon="OUTLINER_OB_LIGHT")
    stage = context.scene.facestage.stage
    softbox = None if stage is None else softbox_of(stage)
    if softbox is not None:
        row = layout.row(align=True)
        row.prop(softbox.data, "size", text="Width")
        row.prop(softbox.data, "size_y", text="Height")
    if draw_task(layout, context, FACESTAGE_OT_prepare_relight.task):
        return
    preview = context.window_manager.facestage_preview
    ready = preview.active or is_file(folder / RELIGHT_CACHE)
    row = layout.row(align=True)
    row.enabled = is_file(folder / RESULT) and not context.window_manager.facestage.task
    if ready:
        row.operator(
            "facestage.relight_preview",
            icon="HIDE_OFF" if preview.active else "HIDE_ON",
            depress=preview.active,
        )
    row.operator("facestage.prepare_relight", icon="FILE_REFRESH", text="" if ready else None)
    camera = context.scene.camera
    if context.scene.facestage.photo and camera is not None:
        layout.operator(
            "facestage.before_after", icon="SPLIT_VERTICAL", depress=photo_in_front(camera)
        )
    if preview.status:
        draw_wrapped(layout.box(), preview.status, "ERROR", line_width(context))


CLASSES = (
    FACESTAGE_OT_relight,
    FACESTAGE_OT_next_light,
    FACESTAGE_OT_light_from_picture,
    FACESTAGE_OT_softbox,
    FACESTAGE_MT_light_from,
    FACESTAGE_OT_relight_preview,
    FACESTAGE_OT_prepare_relight,
    FACESTAGE_OT_before_after,
)
