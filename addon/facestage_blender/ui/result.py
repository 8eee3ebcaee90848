"""Step 5: the result: applied, reported, relit."""

from pathlib import Path
from typing import ClassVar

import bpy
from bpy.props import EnumProperty, StringProperty

from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file
from facestage.contract.relight_cache import RELIGHT_CACHE
from facestage.contract.result import Result
from facestage.contract.result_files import REPORT, RESULT

from ..backend.commands import render_command
from ..backend.process import BackendProcess
from ..drawing import draw_wrapped
from ..exchange.write_back import apply_result
from ..preferences import backend_command
from ..preview import live
from ..rig.face_rig import require_rig
from ..scene.frames import LIGHT_DIRECTIONS
from ..scene.paths import result_folder
from ..scene.relight import relight, restore_lights
from ..skin.displaced_skin import displace, is_displaced
from ..skin.lashes import grow_lashes, has_lids, lashes_of, remove_lashes
from .action import Action
from .backend_task import BackendTask
from .sidebar import SidebarPanel, draw_task, existing, line_width


class FACESTAGE_OT_apply_result(Action, bpy.types.Operator):
    """Puts the last fit into the scene."""

    bl_idname = "facestage.apply_result"
    bl_label = "Apply Result"
    bl_description = (
        "Put the last fit into the scene: sliders, pose, textures, lights and camera, "
        "as one undo step"
    )

    folder: StringProperty(
        name="Folder",
        description="Result folder; empty: the last fit's",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
    )

    def act(self, context: bpy.types.Context) -> None:
        """Load the result and apply it."""
        apply_result(context.scene, Result.load(result_folder(context.scene, self.folder)))


class FACESTAGE_OT_open_report(Action, bpy.types.Operator):
    """Open the last fit's report in the web browser"""

    bl_idname = "facestage.open_report"
    bl_label = "Open Report"
    bl_options: ClassVar[set[str]] = set()

    def act(self, context: bpy.types.Context) -> None:
        """Open the report of the last result."""
        report = result_folder(context.scene) / REPORT
        if not is_file(report):
            raise InputError(f"There is no report at '{report}'; run a fit first.")
        bpy.ops.wm.url_open(url=report.as_uri())


class FACESTAGE_OT_relight(Action, bpy.types.Operator):
    """Light the face from one side with white light, or return to the fitted lights"""

    bl_idname = "facestage.relight"
    bl_label = "Relight"

    direction: EnumProperty(
        name="From",
        description="Where the light comes from, as seen in the picture",
        items=[("fitted", "As fitted", "The lights that the fit found")]
        + [(name, name.capitalize(), f"Light from the {name}") for name in LIGHT_DIRECTIONS],
    )

    def act(self, context: bpy.types.Context) -> None:
        """Change the lights' colors and powers."""
        if self.direction == "fitted":
            restore_lights(context.scene)
        else:
            relight(context.scene, self.direction)


class FACESTAGE_OT_relight_preview(Action, bpy.types.Operator):
    """Turns the live relight preview on and off."""

    bl_idname = "facestage.relight_preview"
    bl_label = "Relight Preview"
    bl_description = (
        "Show the photo relit over the camera's view while you change colors, powers and states "
        "of the lights"
    )
    bl_options: ClassVar[set[str]] = set()

    def act(self, context: bpy.types.Context) -> None:
        """Turn the preview on, or off when it is on."""
        if live.Preview.photo is not None:
            live.stop()
        else:
            live.start(context.scene)


class FACESTAGE_OT_lashes(Action, bpy.types.Operator):
    """Gives the rig lashes, or takes them away."""

    bl_idname = "facestage.lashes"
    bl_label = "Lashes"
    bl_description = (
        "Let the rig have eyelashes, in the color of its brows, that follow its lids; again: none. "
        "Exported files hold none"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Grow them, or remove those that there are."""
        rig = require_rig(context.scene)
        if lashes_of(rig) is None:
            grow_lashes(rig)
        else:
            remove_lashes(rig)


class FACESTAGE_OT_displace_skin(Action, bpy.types.Operator):
    """Turns the displacement of the skin on and off."""

    bl_idname = "facestage.displace_skin"
    bl_label = "Displace Skin"
    bl_description = (
        "Give the skin its wrinkles by the height map, on a mesh that Cycles divides as finely as "
        "the picture needs, instead of by the normal map; once more to go back"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Turn it on, or off when it is on."""
        rig = require_rig(context.scene)
        displace(rig, not is_displaced(rig))


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
        buttons.enabled = is_file(folder / RESULT) and not state.task
        buttons.operator("facestage.apply_result", icon="CHECKMARK")
        report = buttons.row(align=True)
        report.enabled = is_file(folder / REPORT)
        report.operator("facestage.open_report", icon="URL")
        if settings.stage is not None:
            layout.operator_menu_enum(
                "facestage.relight", "direction", text="Light From", icon="LIGHT_SPOT"
            )
            _draw_preview(layout, context, folder)
        rig = settings.rig
        if rig is not None and rig.facestage_face.height_image is not None:
            layout.operator(
                "facestage.displace_skin", icon="MOD_DISPLACE", depress=is_displaced(rig)
            )
        if settings.rig is not None:
            layout.prop(settings, "rig", text="Rig")
            row = layout.row()
            row.enabled = has_lids(settings.rig)
            row.operator(
                "facestage.lashes", icon="STRANDS", depress=lashes_of(settings.rig) is not None
            )
            layout.operator("facestage.export", icon="EXPORT")


def _draw_preview(layout: bpy.types.UILayout, context: bpy.types.Context, folder: Path) -> None:
    """The live preview's switch, or what makes it possible, and why it does not follow the
    lights.
    """
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
    if preview.status:
        draw_wrapped(layout.box(), preview.status, "ERROR", line_width(context))


CLASSES = (
    FACESTAGE_OT_apply_result,
    FACESTAGE_OT_open_report,
    FACESTAGE_OT_relight,
    FACESTAGE_OT_relight_preview,
    FACESTAGE_OT_lashes,
    FACESTAGE_OT_displace_skin,
    FACESTAGE_OT_prepare_relight,
    FACESTAGE_PT_result,
)
