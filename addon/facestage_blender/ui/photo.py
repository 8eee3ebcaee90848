"""Step 1: the photo, or the person's photos, and what is known of them."""

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import bpy
from bpy.props import BoolProperty, CollectionProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from facestage.contract.errors import InputError
from facestage.contract.job import PHOTO_SUFFIXES
from facestage.contract.landmarks import Landmarks
from facestage.contract.result import Result

from ..drawing import draw_wrapped
from ..exchange.photos import add_photos, choose_photo, numbered, remove, show
from ..exchange.write_back import apply_steps
from ..landmarks.empties import HIDDEN, IGNORED, VISIBLE, landmark_empties, shown_plane
from ..landmarks.photo_view import look_through_camera
from ..pins.aiming import aim_camera
from ..scene.own_view import can_give_view_back, give_view_back
from ..scene.paths import absolute
from ..translations import said
from .action import Action, SteppedAction
from .faces import draw_faces
from .landmarks import FACESTAGE_OT_detect_landmarks
from .sidebar import SidebarPanel, draw_task, line_width

FILTER = ";".join(f"*{suffix}" for suffix in PHOTO_SUFFIXES)
FROM = {
    "FILE": "{count} points, from the file",
    "DETECTED": "{count} points, found automatically",
    "EDITED": "{count} points, edited by hand",
}
FEWER = {HIDDEN: "{count} hidden", IGNORED: "{count} ignored"}
MARKS = ((VISIBLE, "HIDE_OFF"), (HIDDEN, "HIDE_ON"), (IGNORED, "X"))


class FACESTAGE_OT_choose_photo(Action, bpy.types.Operator, ImportHelper):
    """Asks for the photo."""

    bl_idname = "facestage.choose_photo"
    bl_label = "Choose Photo"
    bl_description = (
        "Choose the photo. It is shown behind the camera's view; renders get its size and no "
        "tone curve"
    )

    filter_glob: StringProperty(default=FILTER, options={"HIDDEN"})

    def act(self, context: bpy.types.Context) -> None:
        """Remember the photo and show it."""
        choose_photo(context.scene, Path(self.filepath))
        aim_camera(context.scene)
        look_through_camera(context)


class FACESTAGE_OT_add_photos(Action, bpy.types.Operator, ImportHelper):
    """Asks for more photos of the person."""

    bl_idname = "facestage.add_photos"
    bl_label = "Add Photos"
    bl_description = (
        "Add photos of the same person, in any pose, expression and light: one fit explains all "
        "of them, and knows the shape better for it"
    )

    filter_glob: StringProperty(default=FILTER, options={"HIDDEN"})
    files: CollectionProperty(
        type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"}
    )
    directory: StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})

    def act(self, context: bpy.types.Context) -> None:
        """Put them into the list, and show the first of them."""
        chosen = [Path(self.directory) / each.name for each in self.files if each.name]
        add_photos(context.scene, chosen or [Path(self.filepath)])
        look_through_camera(context)


class FACESTAGE_OT_show_photo(SteppedAction, bpy.types.Operator):
    """Shows one of the person's photos."""

    bl_idname = "facestage.show_photo"
    bl_label = "Show Photo"
    bl_description = (
        "Show this photo with its landmarks and lens and, once it is fitted, put its expression, "
        "pose and light into the scene, as one undo step"
    )

    number: IntProperty(name="Photo", description="1 is the first of the list", default=1, min=1)
    apply: BoolProperty(
        name="Apply",
        description="Put the photo's result into the scene, where it has one",
        default=True,
        options={"SKIP_SAVE"},
    )

    def steps(self, context: bpy.types.Context) -> Iterator[None]:
        """Show the photo, and apply its result."""
        scene = context.scene
        result = numbered(scene, self.number).result if self.apply else ""
        # Before anything changes, in case that it is gone.
        fitted = Result.load(absolute(result)) if result and is_fitted(scene) else None
        show(scene, self.number)
        if fitted is not None:
            yield
            yield from apply_steps(scene, fitted)
        look_through_camera(context)


class FACESTAGE_OT_remove_photo(Action, bpy.types.Operator):
    """Take this photo out of the list; its file and its result stay where they are"""

    bl_idname = "facestage.remove_photo"
    bl_label = "Remove Photo"

    number: IntProperty(name="Photo", description="1 is the first of the list", default=1, min=1)

    def act(self, context: bpy.types.Context) -> None:
        """Take it out."""
        remove(context.scene, self.number)


def is_fitted(scene: bpy.types.Scene) -> bool:
    """Whether there is something in the scene that a result could be put into."""
    return scene.facestage.stage is not None and scene.facestage.rig is not None


class FACESTAGE_PT_photo(SidebarPanel, bpy.types.Panel):
    """Step 1: the photo and what is known of it."""

    bl_label = "1  Photo"

    def draw_header(self, _context: bpy.types.Context) -> None:
        """Draw the step's icon."""
        self.layout.label(icon="IMAGE_DATA")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the choice of photo, its landmarks and its lens."""
        layout, settings, state = (
            self.layout,
            context.scene.facestage,
            context.window_manager.facestage,
        )
        draw_faces(layout, context)
        photo = bpy.path.basename(settings.photo)
        if settings.photos:
            draw_photos(layout.column(align=True), context)
        row = layout.row(align=True)
        row.operator("facestage.choose_photo", icon="FILE_FOLDER", text=photo or "Choose Photo")
        if photo:
            row.operator("facestage.add_photos", icon="ADD", text="" if settings.photos else "Add")
        if not draw_task(layout, context, FACESTAGE_OT_detect_landmarks.task):
            row = layout.split(factor=0.62, align=True)
            row.enabled = bool(settings.photo) and not state.task
            row.operator("facestage.detect_landmarks", icon="VIEWZOOM")
            row.prop(settings, "face_number")
        row = layout.row(align=True)
        file = bpy.path.basename(settings.landmarks)
        row.operator(
            "facestage.choose_landmarks", icon="EMPTY_AXIS", text=file or "Choose Landmarks"
        )
        if file:
            row.operator("facestage.forget_landmarks", icon="X", text="")
        if shown_plane(context.scene) is not None:
            draw_editing(layout.box().column(align=True), context)
        else:
            if settings.landmarks:
                layout.operator("facestage.edit_landmarks", icon="GREASEPENCIL")
            column = layout.column(align=True)
            for line in landmark_lines(settings):
                column.label(text=line)


def draw_photos(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """The person's photos, the one that is shown pressed; a fitted one says how it went."""
    settings = context.scene.facestage
    for number, photo in enumerate(settings.photos, 1):
        shown = number == settings.photo_number
        mark = "ERROR" if photo.doubtful else "CHECKMARK" if photo.result else "IMAGE_DATA"
        row = layout.row(align=True)
        # Of the one that is shown the list is a moment behind.
        name = bpy.path.basename(settings.photo if shown else photo.photo)
        row.operator("facestage.show_photo", text=name, icon=mark, depress=shown).number = number
        row.operator("facestage.remove_photo", text="", icon="X").number = number
    photo = settings.photos[settings.photo_number - 1]
    if photo.doubtful:
        draw_wrapped(layout.box(), photo.advice, "ERROR", line_width(context))


def draw_editing(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """What can be done with the points while they are on the photo."""
    empties = landmark_empties(context.scene)
    states = [empty.facestage_landmark.state for empty in empties]
    counts = [
        said(words, count=states.count(state)) for state, words in FEWER.items() if state in states
    ]
    layout.label(text=said("{count} points to drag (G)", count=len(empties)), icon="EMPTY_AXIS")
    if counts:
        layout.label(text=", ".join(counts), icon="BLANK1")
    row = layout.row(align=True)
    for state, icon in MARKS:
        row.operator("facestage.landmark_state", text=state.capitalize(), icon=icon).state = state
    layout.separator()
    row = layout.row(align=True)
    row.operator("facestage.done_landmarks", icon="CHECKMARK")
    row.operator("facestage.revert_landmarks", icon="LOOP_BACK")


def landmark_lines(settings: bpy.types.PropertyGroup) -> list[str]:
    """How many landmarks there are, where they come from, and how many the fit trusts less."""
    if not settings.landmarks:
        return [said("Landmarks: found automatically")]
    try:
        path = absolute(settings.landmarks)
        count, left = _count(path, path.stat().st_mtime_ns)
    except (OSError, InputError):
        return [said("The landmark file cannot be read")]
    return [
        said(FROM[settings.landmarks_from], count=count),
        *([said("{count} hidden or ignored", count=left)] if left else []),
    ]


@lru_cache(maxsize=4)
def _count(path: Path, _changed: int) -> tuple[int, int]:
    """How many landmarks a file holds, and how many of them are hidden or ignored.

    Read once for each change of the file, since panels are drawn all the time. Raises InputError.
    """
    landmarks = Landmarks.read(path)
    return len(landmarks.points), len(landmarks.points) - int(landmarks.counted.sum())


class FACESTAGE_OT_give_camera_back(Action, bpy.types.Operator):
    """Gives the scene what it looked like before the photo."""

    bl_idname = "facestage.give_camera_back"
    bl_label = "Give Back Camera"
    bl_description = (
        "Let the scene have the camera, the resolution and the colors that it had before the "
        "photo. The photo's camera stays; choose the photo again to look through it"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Give it back."""
        give_view_back(context.scene)


class FACESTAGE_PT_camera(SidebarPanel, bpy.types.Panel):
    """What is known of the photo's camera."""

    bl_label = "Camera"
    bl_parent_id = "FACESTAGE_PT_photo"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what the fit may take from the scene's camera."""
        column = self.layout.column(align=True)
        column.prop(context.scene.facestage, "known_lens")
        column.prop(context.scene.facestage, "keep_camera")
        if can_give_view_back(context.scene):
            column.operator("facestage.give_camera_back", icon="LOOP_BACK")


CLASSES = (
    FACESTAGE_OT_choose_photo,
    FACESTAGE_OT_add_photos,
    FACESTAGE_OT_show_photo,
    FACESTAGE_OT_remove_photo,
    FACESTAGE_OT_give_camera_back,
    FACESTAGE_PT_photo,
    FACESTAGE_PT_camera,
)
