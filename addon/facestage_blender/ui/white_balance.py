"""Step 2: the white balance, by a click on something grey in the photo."""

from typing import ClassVar

import bpy
from bpy.props import FloatProperty

from facestage.contract.errors import FacestageError

from ..pictures.grey import read_grey
from ..pictures.images import load_image
from ..scene.paths import require_photo
from .action import Action


class FACESTAGE_OT_pick_white_balance(Action, bpy.types.Operator):
    """Reads the light's color where the user clicks."""

    bl_idname = "facestage.pick_white_balance"
    bl_label = "Pick White Balance"
    bl_description = (
        "Show the photo in an Image Editor and click on something grey or white in it, in the "
        "light that falls on the face: the color it shows is the light's. Right click or Esc ends"
    )
    bl_options: ClassVar[set[str]] = {"REGISTER", "UNDO"}

    x: FloatProperty(
        name="X", description="Pixels from the photo's left edge", min=0, options={"SKIP_SAVE"}
    )
    y: FloatProperty(
        name="Y", description="Pixels from the photo's upper edge", min=0, options={"SKIP_SAVE"}
    )

    _area: bpy.types.Area | None = None
    _was: str = ""  # what the area showed before

    def act(self, context: bpy.types.Context) -> None:
        """Read the color there, and let the next fit know it."""
        settings = context.scene.facestage
        settings.white_balance = read_grey(require_photo(context.scene), self.x, self.y)
        settings.white_balance_known = True

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Show the photo and wait for the click."""
        try:
            image = load_image(require_photo(context.scene))
        except FacestageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        areas = context.window.screen.areas
        editor = next((area for area in areas if area.type == "IMAGE_EDITOR"), context.area)
        self._area, self._was = editor, editor.type
        editor.type = "IMAGE_EDITOR"
        editor.spaces.active.image = image
        context.window.cursor_modal_set("EYEDROPPER")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Take the first click on the photo; looking around in it is free."""
        if event.type in {"RIGHTMOUSE", "ESC"}:
            self._give_back(context)
            return {"CANCELLED"}
        region = self._under(event)
        if event.type != "LEFTMOUSE" or event.value != "PRESS" or region is None:
            return {"PASS_THROUGH"}
        at = region.view2d.region_to_view(event.mouse_x - region.x, event.mouse_y - region.y)
        width, height = load_image(require_photo(context.scene)).size
        self._give_back(context)
        if not (0 <= at[0] < 1 and 0 < at[1] <= 1):
            self.report({"ERROR"}, "That is beside the photo; press again and click on it.")
            return {"CANCELLED"}
        self.x, self.y = at[0] * width, (1.0 - at[1]) * height
        return self.execute(context)

    def cancel(self, context: bpy.types.Context) -> None:
        """Blender ends the operator by itself."""
        self._give_back(context)

    def _under(self, event: bpy.types.Event) -> bpy.types.Region | None:
        """The part of the editor that shows the photo, where the mouse is over it."""
        regions = [] if self._area is None else self._area.regions
        for region in regions:
            across, up = event.mouse_x - region.x, event.mouse_y - region.y
            if region.type == "WINDOW" and 0 <= across < region.width and 0 <= up < region.height:
                return region
        return None

    def _give_back(self, context: bpy.types.Context) -> None:
        context.window.cursor_modal_restore()
        if self._area is not None:
            self._area.type = self._was
        self._area = None


def draw_white_balance(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    """Whether it is known, the color, and the eyedropper."""
    row = layout.row(align=True)
    row.prop(settings, "white_balance_known")
    color = row.row(align=True)
    color.active = settings.white_balance_known
    color.prop(settings, "white_balance", text="")
    row.operator("facestage.pick_white_balance", icon="EYEDROPPER", text="")


CLASSES = (FACESTAGE_OT_pick_white_balance,)
