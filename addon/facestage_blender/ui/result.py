"""Step 5: the result: applied, reported."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import bpy
from bpy.props import StringProperty

from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file
from facestage.contract.result import Result
from facestage.contract.result_files import REPORT, RESULT

from ..exchange.asset import asset_of
from ..exchange.write_back import apply_steps
from ..rig.certainty import has_certainty, show_certainty, shows_certainty
from ..rig.face_rig import require_rig
from ..scene.color_views import show_skin, shows_skin
from ..scene.paths import result_folder
from ..scene.several import separate_light
from ..skin.brows import brows_of, grow_brows, has_brows, remove_brows
from ..skin.displaced_skin import displace, is_displaced
from ..skin.lashes import grow_lashes, lashes_of, remove_lashes
from ..skin.lids import has_lids
from ..skin.pores import give_pores, pores_of, remove_pores
from ..skin.wet_eyes import dry_eyes, wet_eyes, wet_eyes_of
from .action import Action, SteppedAction, Toggle
from .relight import draw_light
from .sidebar import SidebarPanel, existing


class FACESTAGE_OT_apply_result(SteppedAction, bpy.types.Operator):
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

    def steps(self, context: bpy.types.Context) -> Iterator[None]:
        """Load the result and apply it."""
        result = Result.load(result_folder(context.scene, self.folder))
        yield
        yield from apply_steps(context.scene, result)


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


class FACESTAGE_OT_lashes(Toggle, bpy.types.Operator):
    """Gives the rig lashes, or takes them away."""

    bl_idname = "facestage.lashes"
    bl_label = "Lashes"
    bl_description = (
        "Let the rig have eyelashes, in the color of its brows, that follow its lids; again: none. "
        "Exported files hold none"
    )

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether it has any."""
        return lashes_of(require_rig(context.scene)) is not None

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Grow them, or remove those that there are."""
        rig = require_rig(context.scene)
        if on:
            grow_lashes(rig)
        else:
            remove_lashes(rig)
        separate_light(context.scene)


class FACESTAGE_OT_brows(Toggle, bpy.types.Operator):
    """Gives the rig brow hair, or takes it away."""

    bl_idname = "facestage.brows"
    bl_label = "Brow Hair"
    bl_description = (
        "Let brow hair grow where the albedo has brows, as dense as it is dark and in its color; "
        "again: none. Exported files hold none"
    )

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether it has any."""
        return brows_of(require_rig(context.scene)) is not None

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Grow it, or remove what there is."""
        rig = require_rig(context.scene)
        if on:
            grow_brows(rig)
        else:
            remove_brows(rig)
        separate_light(context.scene)


class FACESTAGE_OT_wet_eyes(Toggle, bpy.types.Operator):
    """Gives the eyes cornea and tears, or takes them away."""

    bl_idname = "facestage.wet_eyes"
    bl_label = "Wet Eyes"
    bl_description = (
        "Give the eyes a clear cornea with the iris behind it, and tears along the lids; they "
        "follow gaze and lids. Not fitted, and not in exported files; again: none"
    )

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether they are wet."""
        return wet_eyes_of(require_rig(context.scene)) is not None

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Wet them, or dry them."""
        rig = require_rig(context.scene)
        if on:
            wet_eyes(rig)
        else:
            dry_eyes(rig)
        separate_light(context.scene)


class FACESTAGE_OT_pores(Toggle, bpy.types.Operator):
    """Gives the skin made-up pores, or takes them away."""

    bl_idname = "facestage.pores"
    bl_label = "Made-up Pores"
    bl_description = (
        "Give the skin pores and fine relief that no photo shows: made up, as dense as was "
        "measured on faces. Not fitted, and not in exported files; again: none"
    )

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether it has any."""
        return pores_of(require_rig(context.scene)) is not None

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Give them, or remove those that there are."""
        rig = require_rig(context.scene)
        if on:
            give_pores(rig)
        else:
            remove_pores(rig)


class FACESTAGE_OT_displace_skin(Toggle, bpy.types.Operator):
    """Turns the displacement of the skin on and off."""

    bl_idname = "facestage.displace_skin"
    bl_label = "Displace Skin"
    bl_description = (
        "Give the skin its wrinkles by the height map, on a mesh that Cycles divides as finely as "
        "the picture needs, instead of by the normal map; once more to go back"
    )

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether it is displaced."""
        return is_displaced(require_rig(context.scene))

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Displace it, or no more."""
        displace(require_rig(context.scene), on)


class FACESTAGE_OT_show_certainty(Toggle, bpy.types.Operator):
    """Shows the fit's deviations as colors."""

    bl_idname = "facestage.show_certainty"
    bl_label = "Show Certainty"
    bl_description = (
        "Show on the face how sure the fit is of each place, in the colors of the report: dark "
        "where it is sure, yellow where it is not. The 3D views go to Solid; again: back to what "
        "they showed. Not in exported files"
    )

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only where the result that was applied says how sure it is."""
        cls.poll_message_set("The face has no standard deviations; apply the result of a new fit")
        rig = context.scene.facestage.rig
        return rig is not None and has_certainty(rig.data)

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether they are shown."""
        return shows_certainty(require_rig(context.scene).data)

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Show them, or what was shown before."""
        show_certainty(require_rig(context.scene).data, on)


class FACESTAGE_OT_show_skin(Toggle, bpy.types.Operator):
    """Shows the face's textures in Solid views."""

    bl_idname = "facestage.show_skin"
    bl_label = "Show Skin"
    bl_description = (
        "Show the face's albedo in 3D views that are Solid, at once and without a render; again: "
        "the grey clay that shows its form. Applying a result turns it on"
    )

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether it is shown."""
        return shows_skin(require_rig(context.scene).data)

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Show it, or the clay."""
        show_skin(require_rig(context.scene).data, on)


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
            draw_light(layout, context, folder)
        rig = settings.rig
        if rig is not None and rig.facestage_face.height_image is not None:
            layout.operator(
                "facestage.displace_skin", icon="MOD_DISPLACE", depress=is_displaced(rig)
            )
        if settings.rig is not None:
            layout.prop(settings, "rig", text="Rig")
            grows = layout.column(align=True)
            row = grows.row(align=True)
            row.enabled = has_lids(settings.rig)
            row.operator(
                "facestage.lashes", icon="STRANDS", depress=lashes_of(settings.rig) is not None
            )
            row = grows.row(align=True)
            row.enabled = has_brows(settings.rig)
            row.operator(
                "facestage.brows", icon="CURVES", depress=brows_of(settings.rig) is not None
            )
            row = grows.row(align=True)
            row.enabled = has_lids(settings.rig)
            row.operator(
                "facestage.wet_eyes", icon="HIDE_OFF", depress=wet_eyes_of(settings.rig) is not None
            )
            pores = pores_of(settings.rig)
            row = layout.row(align=True)
            row.operator(
                "facestage.pores", icon="OUTLINER_DATA_POINTCLOUD", depress=pores is not None
            )
            if pores is not None:
                row.prop(pores, "default_value", text="Depth", slider=True)
            shown = layout.column(align=True)
            shown.operator(
                "facestage.show_skin", icon="TEXTURE", depress=shows_skin(settings.rig.data)
            )
            shown.operator(
                "facestage.show_certainty", icon="COLOR", depress=shows_certainty(settings.rig.data)
            )
            files = layout.column(align=True)
            files.operator("facestage.export", icon="EXPORT")
            files.operator(
                "facestage.mark_as_asset",
                icon="ASSET_MANAGER",
                depress=asset_of(settings.rig) is not None,
            )


CLASSES = (
    FACESTAGE_OT_apply_result,
    FACESTAGE_OT_open_report,
    FACESTAGE_OT_lashes,
    FACESTAGE_OT_brows,
    FACESTAGE_OT_wet_eyes,
    FACESTAGE_OT_pores,
    FACESTAGE_OT_displace_skin,
    FACESTAGE_OT_show_certainty,
    FACESTAGE_OT_show_skin,
    FACESTAGE_PT_result,
)
