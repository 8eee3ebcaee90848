"""The sidebar of the 3D View from the light stage on: the steps in order, progress, and errors in
words.
"""

from collections.abc import Callable
from pathlib import Path

import bpy

from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file, is_folder
from facestage.contract.partial import partial_folder
from facestage.contract.relight_cache import RELIGHT_CACHE

from ..preferences import draw_wrapped
from ..scene.paths import result_folder, work_folder
from ..scene.stage import stage_lights
from .operators import REPORT
from .operators_model import model_label, model_license

CHARACTERS_PER_PIXEL = 1 / 8.0


class SidebarPanel:
    """Where all panels of Facestage live."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Facestage"


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


class FACESTAGE_PT_face(SidebarPanel, bpy.types.Panel):
    """Step 3: the face rig."""

    bl_label = "3  Face"

    def draw_header(self, _context: bpy.types.Context) -> None:
        """Draw the step's icon."""
        self.layout.label(icon="USER")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the choice of model and the rig's builder."""
        layout, settings = self.layout, context.scene.facestage
        layout.menu("FACESTAGE_MT_model", text=model_label(settings.model), icon="USER")
        draw_wrapped(
            layout, f"License: {model_license(context.scene)}", "NONE", line_length(context)
        )
        built = settings.rig is not None
        layout.operator(
            "facestage.build_rig",
            icon="FILE_REFRESH" if built else "ADD",
            text="Rebuild Face Rig" if built else None,
        )


class FACESTAGE_PT_fit(SidebarPanel, bpy.types.Panel):
    """Step 4: the fit, its progress and its errors."""

    bl_label = "4  Fit"

    def draw_header(self, _context: bpy.types.Context) -> None:
        """Draw the step's icon."""
        self.layout.label(icon="MOD_SHRINKWRAP")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the fit's button or its progress."""
        layout, settings, state = (
            self.layout,
            context.scene.facestage,
            context.window_manager.facestage,
        )
        if state.task:
            draw_progress(layout, state)
        else:
            ready = bool(settings.photo and settings.stage and settings.rig)
            row = layout.row(align=True)
            row.enabled, row.scale_y = ready, 1.5
            row.operator("facestage.fit", icon="PLAY")
            folder = existing(work_folder, context.scene)
            if ready and folder is not None and is_folder(partial_folder(folder / "result")):
                row.operator("facestage.fit", icon="RECOVER_LAST", text="Resume").resume = True
            if not ready:
                missing = [
                    name
                    for name, value in (
                        ("photo", settings.photo),
                        ("light stage", settings.stage),
                        ("face", settings.rig),
                    )
                    if not value
                ]
                layout.label(text=f"Still needed: {', '.join(missing)}", icon="INFO")
        if state.failure:
            draw_wrapped(layout.box(), state.failure, "ERROR", line_length(context))


class FACESTAGE_PT_options(SidebarPanel, bpy.types.Panel):
    """What the fit may change, and how long it may take."""

    bl_label = "Options"
    bl_parent_id = "FACESTAGE_PT_fit"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the fit's options."""
        layout, settings = self.layout, context.scene.facestage
        layout.use_property_split, layout.use_property_decorate = True, False
        layout.prop(settings, "start_from_rig")
        layout.prop(settings, "quality")
        layout.prop(settings, "budget")
        layout.prop(settings, "device")
        layout.prop(settings, "seed")
        layout.prop(settings, "output")
        layout.label(text="Keep as is")
        grid = layout.grid_flow(columns=2, align=True, row_major=True)
        grid.use_property_split = False
        grid.prop(settings, "freeze")
        column = layout.column(align=True, heading="Trust")
        for name in ("photo", "landmarks", "prior", "light"):
            column.prop(settings, f"weight_{name}")


class FACESTAGE_PT_result(SidebarPanel, bpy.types.Panel):
    """Step 5: the result."""

    bl_label = "5  Result"

    def draw_header(self, _context: bpy.types.Context) -> None:
        """Draw the step's icon."""
        self.layout.label(icon="SHADING_RENDERED")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what can be done with a result."""
        layout, settings, state = (
            self.layout,
            context.scene.facestage,
            context.window_manager.facestage,
        )
        folder = existing(result_folder, context.scene) or Path()
        buttons = layout.column(align=True)
        buttons.enabled = is_file(folder / "result.json") and not state.task
        buttons.operator("facestage.apply_result", icon="CHECKMARK")
        report = buttons.row(align=True)
        report.enabled = is_file(folder / REPORT)
        report.operator("facestage.open_report", icon="URL")
        if settings.stage is not None:
            layout.operator_menu_enum(
                "facestage.relight", "direction", text="Light From", icon="LIGHT_SPOT"
            )
            _draw_preview(layout, context, folder)
        if settings.rig is not None:
            layout.prop(settings, "rig", text="Rig")
        if state.message and not state.task:
            icon = "ERROR" if state.doubtful else "INFO"
            draw_wrapped(layout.box(), state.message, icon, line_length(context))


def existing(folder: Callable[[bpy.types.Scene], Path], scene: bpy.types.Scene) -> Path | None:
    """A folder of the scene's; None where what is set can be none: the operators say what is wrong,
    a panel draws.
    """
    try:
        return folder(scene)
    except InputError:
        return None


def _draw_preview(layout: bpy.types.UILayout, context: bpy.types.Context, folder: Path) -> None:
    """The live preview's switch, or what makes it possible, and why it does not follow the
    lights.
    """
    preview = context.window_manager.facestage_preview
    ready = preview.active or is_file(folder / RELIGHT_CACHE)
    row = layout.row(align=True)
    row.enabled = is_file(folder / "result.json") and not context.window_manager.facestage.task
    if ready:
        row.operator(
            "facestage.relight_preview",
            icon="HIDE_OFF" if preview.active else "HIDE_ON",
            depress=preview.active,
        )
    row.operator("facestage.prepare_relight", icon="FILE_REFRESH", text="" if ready else None)
    if preview.status:
        draw_wrapped(layout.box(), preview.status, "ERROR", line_length(context))


def draw_progress(layout: bpy.types.UILayout, state: bpy.types.PropertyGroup) -> None:
    """The running task's bar, what it says of itself, and Cancel."""
    text = f"{state.task}: {state.stage}" if state.stage else state.task
    row = layout.row(align=True)
    if hasattr(row, "progress"):
        row.progress(text=f"{state.fraction:.0%}  {text}", factor=state.fraction, type="BAR")
    else:
        row.prop(state, "fraction", text=text, slider=True)
    row.operator("facestage.cancel", icon="CANCEL", text="")
    details = []
    if state.photo_error >= 0:
        details.append(f"photo error {state.photo_error:.4f}")
    if state.seconds_left >= 0:
        details.append(f"about {state.seconds_left:.0f} s left")
    if state.cancel:
        details = ["Stopping ..."]
    if details:
        layout.label(text=", ".join(details), icon="TIME")


def line_length(context: bpy.types.Context) -> int:
    """About how many characters go into a line of the sidebar."""
    scale = context.preferences.system.ui_scale
    return max(20, int((context.region.width / scale - 40) * CHARACTERS_PER_PIXEL))


CLASSES = (
    FACESTAGE_PT_stage,
    FACESTAGE_PT_lights,
    FACESTAGE_PT_face,
    FACESTAGE_PT_fit,
    FACESTAGE_PT_options,
    FACESTAGE_PT_result,
)
