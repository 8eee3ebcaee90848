"""Step 1: the photo and what is known of it."""

from functools import lru_cache
from pathlib import Path

import bpy
from bpy.props import StringProperty
from bpy_extras.io_utils import ImportHelper

from facestage.contract.errors import InputError
from facestage.contract.job import PHOTO_SUFFIXES
from facestage.contract.landmarks import Landmarks

from ..landmarks.editing import forget_landmarks
from ..landmarks.empties import HIDDEN, IGNORED, VISIBLE, landmark_empties, shown_plane
from ..landmarks.photo_view import look_through_camera
from ..scene.camera import ensure_camera, show_photo
from ..scene.paths import absolute
from ..scene.stage import facestage_collection
from .action import Action
from .landmarks import FACESTAGE_OT_detect_landmarks
from .sidebar import SidebarPanel, draw_task

FROM = {"FILE": "from the file", "DETECTED": "found automatically", "EDITED": "edited by hand"}
MARKS = ((VISIBLE, "HIDE_OFF"), (HIDDEN, "HIDE_ON"), (IGNORED, "X"))


class FACESTAGE_OT_choose_photo(Action, bpy.types.Operator, ImportHelper):
    """Asks for the photo."""

    bl_idname = "facestage.choose_photo"
    bl_label = "Choose Photo"
    bl_description = (
        "Choose the photo. It is shown behind the camera's view; renders get its size and no "
        "tone curve"
    )

    filter_glob: StringProperty(
        default=";".join(f"*{suffix}" for suffix in PHOTO_SUFFIXES), options={"HIDDEN"}
    )

    def act(self, context: bpy.types.Context) -> None:
        """Remember the photo and show it."""
        choose_photo(context.scene, Path(self.filepath))
        look_through_camera(context)


def choose_photo(scene: bpy.types.Scene, path: Path) -> None:
    """Make ``path`` the scene's photo and show it behind the camera.

    Raises InputError when it is no picture.
    """
    path, settings = absolute(str(path)), scene.facestage
    show_photo(scene, ensure_camera(scene, facestage_collection(scene)), path)
    if settings.photo and absolute(settings.photo) != path:
        forget_landmarks(scene)  # they are of the photo before, as is its light
        settings.white_balance_known = False
    settings.photo = str(path)


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
        photo = bpy.path.basename(settings.photo)
        layout.operator("facestage.choose_photo", icon="FILE_FOLDER", text=photo or "Choose Photo")
        if not draw_task(layout, context, FACESTAGE_OT_detect_landmarks.task):
            row = layout.row(align=True)
            row.enabled = bool(settings.photo) and not state.task
            row.operator("facestage.detect_landmarks", icon="VIEWZOOM")
            face = row.row(align=True)
            face.ui_units_x = 4.5
            face.prop(settings, "face_number")
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


def draw_editing(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """What can be done with the points while they are on the photo."""
    empties = landmark_empties(context.scene)
    states = [empty.facestage_landmark.state for empty in empties]
    counts = [
        f"{states.count(state)} {state.lower()}" for state in (HIDDEN, IGNORED) if state in states
    ]
    layout.label(text=f"{len(empties)} points to drag (G)", icon="EMPTY_AXIS")
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
        return ["Landmarks: found automatically"]
    try:
        path = absolute(settings.landmarks)
        count, left = _count(path, path.stat().st_mtime_ns)
    except (OSError, InputError):
        return ["The landmark file cannot be read"]
    return [
        f"{count} points, {FROM[settings.landmarks_from]}",
        *([f"{left} hidden or ignored"] if left else []),
    ]


@lru_cache(maxsize=4)
def _count(path: Path, _changed: int) -> tuple[int, int]:
    """How many landmarks a file holds, and how many of them are hidden or ignored.

    Read once for each change of the file, since panels are drawn all the time. Raises InputError.
    """
    landmarks = Landmarks.read(path)
    return len(landmarks.points), len(landmarks.points) - int(landmarks.counted.sum())


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


CLASSES = (FACESTAGE_OT_choose_photo, FACESTAGE_PT_photo, FACESTAGE_PT_camera)
