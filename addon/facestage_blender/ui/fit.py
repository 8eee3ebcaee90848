"""Step 4: the fit, its options, its progress and its errors."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import bpy
from bpy.props import BoolProperty

from facestage.contract.files.partial import partial_folder
from facestage.contract.files.paths import is_folder
from facestage.contract.result import CONVERGED, Result

from ..backend.commands import fit_command
from ..backend.process import BackendProcess
from ..drawing import draw_wrapped
from ..exchange.photos import stored_photos, take_results
from ..exchange.scene_read import read_jobs
from ..exchange.write_back import apply_steps
from ..preferences import backend_command
from ..properties import BY_ANGLE, FROM_PHOTO
from ..scene.paths import RESULT_FOLDER, absolute, job_folders, result_folder, work_folder
from ..translations import said
from .backend_task import BackendTask
from .pins import draw_pins
from .sidebar import SidebarPanel, draw_task, existing, line_width


class FACESTAGE_OT_fit(BackendTask, bpy.types.Operator):
    """Fits the face and the lights."""

    bl_idname = "facestage.fit"
    bl_label = "Fit to Photo"
    bl_description = (
        "Fit the face and the lights to the photo, or to all photos of the person together. "
        "Blender stays usable; Cancel stops it"
    )
    bl_options = {"REGISTER", "UNDO"}

    task = "Fitting"
    resumable = True
    photos: Sequence[Path] = ()  # several, in the order of their jobs

    resume: BoolProperty(
        name="Resume",
        description="Go on from the last checkpoint of a fit that was stopped",
        options={"SKIP_SAVE"},
    )
    apply: BoolProperty(
        name="Apply",
        description="Put the result into the scene when the fit is done",
        default=True,
        options={"SKIP_SAVE"},
    )

    def command(self, context: bpy.types.Context) -> list[str]:
        """Write the job and say how to fit it."""
        context.window_manager.facestage.verdict = ""
        folder = work_folder(context.scene)
        backend = backend_command(context)
        self.photos = [absolute(photo.photo) for photo in stored_photos(context.scene)]
        folders = job_folders(folder, len(self.photos))
        if not self.resume:
            for job, path in zip(read_jobs(context.scene), folders, strict=True):
                job.save(path)
        return fit_command(backend, folders, folder / RESULT_FOLDER, self.resume)

    def finish(self, context: bpy.types.Context, _process: BackendProcess) -> None:
        """Remember the result."""
        folder = work_folder(context.scene) / RESULT_FOLDER
        fitted = take_results(context.scene, folder, self.photos)
        state = context.window_manager.facestage
        state.verdict, state.doubtful = fitted.advice, fitted.status != CONVERGED
        self.report({"WARNING" if state.doubtful else "INFO"}, said(fitted.advice))

    def following(self, context: bpy.types.Context) -> Iterator[None]:
        """Apply the result."""
        if self.apply:
            result = Result.load(result_folder(context.scene))
            yield
            yield from apply_steps(context.scene, result)


def draw_skin_tone(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    """What it is, if anybody knows, and what that usually looks like."""
    column = layout.column(align=True)
    split = column.split(factor=0.33, align=True)
    split.label(text="Skin Tone")
    row = split.row(align=True)
    row.prop(settings, "skin_tone", text="")
    if settings.skin_tone != FROM_PHOTO:
        color = row.row(align=True)
        color.ui_units_x = 2
        color.prop(settings, "skin_color", text="")
    if settings.skin_tone == BY_ANGLE:
        column.prop(settings, "skin_angle")


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
        if not draw_task(layout, context, FACESTAGE_OT_fit.task, ""):
            draw_skin_tone(layout, settings)
            ready = bool(settings.photo and settings.stage and settings.rig)
            row = layout.row(align=True)
            row.enabled, row.scale_y = ready and not state.task, 1.5
            count = len(settings.photos)
            several = {"text": said("Fit to {count} Photos", count=count)} if count else {}
            row.operator("facestage.fit", icon="PLAY", **several)
            folder = existing(work_folder, context.scene)
            if ready and folder is not None and is_folder(partial_folder(folder / RESULT_FOLDER)):
                row.operator("facestage.fit", icon="RECOVER_LAST", text="Resume").resume = True
            if not ready:
                missing = [
                    name
                    for name, value in (
                        (said("photo"), settings.photo),
                        (said("light stage"), settings.stage),
                        (said("face"), settings.rig),
                    )
                    if not value
                ]
                layout.label(
                    text=said("Still needed: {what}", what=", ".join(missing)), icon="INFO"
                )
        draw_pins(layout, context)
        if state.verdict:
            icon = "ERROR" if state.doubtful else "INFO"
            draw_wrapped(layout.box(), state.verdict, icon, line_width(context))


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
        layout.prop(settings, "texture_size")
        layout.prop(settings, "device")
        layout.prop(settings, "seed")
        layout.prop(settings, "output")
        layout.label(text="Keep as Is")
        grid = layout.grid_flow(columns=2, align=True, row_major=True)
        grid.use_property_split = False
        grid.prop(settings, "freeze")
        layout.label(text="Trust")
        column = layout.column(align=True)
        for name in ("photo", "landmarks", "prior", "light"):
            column.prop(settings, f"weight_{name}")


CLASSES = (FACESTAGE_OT_fit, FACESTAGE_PT_fit, FACESTAGE_PT_options)
