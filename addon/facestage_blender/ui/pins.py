"""Step 4: pins, by which the face is dragged to where the photo shows it."""

from typing import ClassVar

import bpy
import numpy as np
from bpy.props import FloatVectorProperty, IntProperty

from facestage.contract.errors import FacestageError, InputError

from ..landmarks.photo_view import look_at
from ..pins.overlay import photo_lens
from ..pins.pinning import Pinning, place_by_landmarks
from ..pins.record import pin_count
from ..pins.screen import PhotoOnScreen
from ..rig.face_rig import require_rig
from ..scene.camera import camera_pose, put_photo_in_front, require_camera
from ..scene.paths import require_photo
from ..translations import said
from .action import Action, Toggle

TOOL = "facestage.pins"
SELECT_TOOL = "builtin.select_box"
REACH = 12.0  # pixels of the screen, at a scale of 1, around a pin


class FACESTAGE_OT_pin_face(Toggle, bpy.types.Operator):
    """Shows the face as a wireframe over the photo."""

    bl_idname = "facestage.pin_face"
    bl_label = "Pin Face"
    bl_description = (
        "Show the face as a wireframe over the photo, and drag it there by the mouse: each place "
        "that you take hold of becomes a pin, and the rest of the face follows. A face that was "
        "not fitted yet is put where the landmarks are; once more to end"
    )

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether the wireframe is shown."""
        return bool(context.scene.facestage.pinning)

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Begin, or end."""
        scene = context.scene
        settings, camera = scene.facestage, require_camera(scene)
        if on:
            require_photo(scene)
            Pinning(scene)  # says what is missing
            if settings.landmarks and not settings.result and not settings.pins:
                place_by_landmarks(scene)
        settings.pinning = on
        put_photo_in_front(camera, on)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Begin or end, in the view too."""
        verdict = super().execute(context)
        if verdict == {"FINISHED"} and not bpy.app.background:
            pinning = context.scene.facestage.pinning
            if pinning:
                look_at(context, Pinning(context.scene).landmarks)
                if context.mode != "OBJECT":
                    bpy.ops.object.mode_set(mode="OBJECT")
            if context.space_data is not None and context.space_data.type == "VIEW_3D":
                bpy.ops.wm.tool_set_by_id(name=TOOL if pinning else SELECT_TOOL)
        return verdict


class FACESTAGE_OT_drag_pin(bpy.types.Operator):
    """Makes a pin, or moves one."""

    bl_idname = "facestage.drag_pin"
    bl_label = "Drag Pin"
    bl_description = (
        "Put the point of the face that the photo shows at one pixel on another one; the rest of "
        "the face follows. Esc puts it back"
    )
    bl_options: ClassVar[set[str]] = {"UNDO"}

    start: FloatVectorProperty(
        name="From", description="Where the face is taken, in pixels of the photo", size=2
    )
    to: FloatVectorProperty(
        name="To", description="Where it is put, in pixels of the photo", size=2
    )

    pinning: Pinning | None = None
    pin = 0
    offset: np.ndarray | None = None

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Drag without a mouse."""
        try:
            pinning = Pinning(context.scene)
            index = pinning.grab(np.array(self.start), 0.5)
            pinning.move(index, np.array(self.to))
            pinning.settle()
            pinning.keep()
        except FacestageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Take hold of the face; where the tool was chosen in the toolbar, show it first."""
        if not context.scene.facestage.pinning:
            return set(bpy.ops.facestage.pin_face(state="ON"))
        try:
            screen = photo_on_screen(context)
            pixel = screen.to_photo((event.mouse_region_x, event.mouse_region_y))
            self.pinning = Pinning(context.scene)
            self.pin = self.pinning.grab(pixel, _reach(context, screen))
        except FacestageError as error:
            self.report({"WARNING"}, str(error))
            return {"CANCELLED"}
        # A pin that is taken at its edge does not jump.
        self.offset = self.pinning.pins.points[self.pin] - pixel
        self.start = self.pinning.pins.points[self.pin]
        context.window_manager.modal_handler_add(self)
        context.area.tag_redraw()
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Follow the mouse until it is let go."""
        assert self.pinning is not None
        if event.type in {"ESC", "RIGHTMOUSE"}:
            self.cancel(context)
            return {"CANCELLED"}
        if event.type == "LEFTMOUSE" and event.value == "RELEASE":
            self.pinning.settle()
            self.pinning.keep()
            self.to = self.pinning.pins.points[self.pin]
            context.area.tag_redraw()
            return {"FINISHED"}
        if event.type == "MOUSEMOVE":
            place = event.mouse_region_x, event.mouse_region_y
            pixel = photo_on_screen(context).to_photo(place) + self.offset
            self.pinning.move(self.pin, pixel)
            self.pinning.keep()
            context.area.tag_redraw()
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        """Put the face back; Blender calls it too when the window closes."""
        if self.pinning is not None:
            self.pinning.give_back()
        if context.area is not None:
            context.area.tag_redraw()


class FACESTAGE_OT_remove_pin(Action, bpy.types.Operator):
    """Removes one pin."""

    bl_idname = "facestage.remove_pin"
    bl_label = "Remove Pin"
    bl_description = "Take away the pin under the pointer; the face follows those that are left"
    bl_options: ClassVar[set[str]] = {"UNDO"}

    number: IntProperty(name="Pin", description="1 is the first that was set", default=1, min=1)

    def act(self, context: bpy.types.Context) -> None:
        """Remove it."""
        pinning = Pinning(context.scene)
        if self.number > len(pinning.pins):
            raise InputError(f"There is no pin {self.number}; the photo has {len(pinning.pins)}.")
        pinning.remove(self.number - 1)
        pinning.keep()

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Remove the one under the pointer."""
        if not context.scene.facestage.pinning:
            return {"PASS_THROUGH"}
        try:
            screen = photo_on_screen(context)
            pixel = screen.to_photo((event.mouse_region_x, event.mouse_region_y))
            index = Pinning(context.scene).nearest(pixel, _reach(context, screen))
        except FacestageError as error:
            self.report({"WARNING"}, str(error))
            return {"CANCELLED"}
        if index is None:  # the right button opens Blender's menu there
            return {"PASS_THROUGH"} if event.type == "RIGHTMOUSE" else {"CANCELLED"}
        self.number = index + 1
        return self.execute(context)


class FACESTAGE_OT_clear_pins(Action, bpy.types.Operator):
    """Take all pins of the photo away. The face stays as it is"""

    bl_idname = "facestage.clear_pins"
    bl_label = "Clear Pins"

    def act(self, context: bpy.types.Context) -> None:
        """Forget them."""
        context.scene.facestage.pins = ""


class FACESTAGE_TOOL_pins(bpy.types.WorkSpaceTool):
    """The mouse while the face is pinned."""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = TOOL
    bl_label = "Pin Face"
    bl_description = "Drag the face's wireframe to where the photo shows it"
    bl_icon = "ops.generic.select"
    bl_keymap = (
        ("facestage.drag_pin", {"type": "LEFTMOUSE", "value": "PRESS"}, None),
        ("facestage.remove_pin", {"type": "RIGHTMOUSE", "value": "PRESS"}, None),
        ("facestage.remove_pin", {"type": "X", "value": "PRESS"}, None),
    )


def photo_on_screen(context: bpy.types.Context) -> PhotoOnScreen:
    """Where the view in use shows the photo.

    Raises InputError when it does not look through the camera.
    """
    view, region = context.region_data, context.region
    if view is None or view.view_perspective != "CAMERA":
        raise InputError("Pins are set on the photo; look through the camera first (Numpad 0).")
    camera = require_camera(context.scene)
    require_rig(context.scene)
    return PhotoOnScreen.of(
        np.array(view.perspective_matrix),
        (region.width, region.height),
        camera_pose(camera),
        photo_lens(context.scene),
    )


def draw_pins(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The switch, how many pins there are, and their end."""
    settings = context.scene.facestage
    row = layout.row(align=True)
    row.enabled = bool(settings.photo and settings.rig)
    row.operator("facestage.pin_face", icon="PINNED", depress=settings.pinning)
    count = pin_count(settings)
    if count:
        row.operator("facestage.clear_pins", icon="X", text="")
    if settings.pinning:
        column = layout.column(align=True)
        column.label(text="Drag the wireframe", icon="MOUSE_LMB_DRAG")
        column.label(text="Right click on a pin: remove it", icon="MOUSE_RMB")
        if not settings.known_lens and not settings.keep_camera:
            column.prop(settings, "pin_focal")
    if count:
        one, several = (
            said("1 pin for the next fit"),
            said("{count} pins for the next fit", count=count),
        )
        layout.label(text=one if count == 1 else several)


def register() -> None:
    """Add the tool to the 3D View."""
    if not bpy.app.background:
        bpy.utils.register_tool(FACESTAGE_TOOL_pins, separator=True)


def unregister() -> None:
    """Undo :func:`register`."""
    if not bpy.app.background:
        bpy.utils.unregister_tool(FACESTAGE_TOOL_pins)


def _reach(context: bpy.types.Context, screen: PhotoOnScreen) -> float:
    """How far from a pin, in pixels of the photo, it can be taken."""
    scale = float(context.preferences.system.ui_scale)
    return REACH * scale / max(screen.scale, 1e-6)


CLASSES = (
    FACESTAGE_OT_pin_face,
    FACESTAGE_OT_drag_pin,
    FACESTAGE_OT_remove_pin,
    FACESTAGE_OT_clear_pins,
)
