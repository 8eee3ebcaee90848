"""Step 1: the landmarks of the photo: found, chosen, edited on the photo, kept or reverted."""

from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from facestage.contract.landmarks import Landmarks

from ..backend.commands import detect_command
from ..backend.process import BackendProcess, Outcome
from ..landmarks import empties
from ..landmarks.editing import (
    DETECTED,
    choose_landmarks,
    edit_landmarks,
    forget_landmarks,
    free_path,
    keep_landmarks,
    mark_landmarks,
)
from ..landmarks.photo_view import look_at_face
from ..landmarks.plane import photo_size
from ..pictures.images import load_image
from ..pins.aiming import aim_camera
from ..preferences import backend_command
from ..scene.paths import require_photo, work_folder
from .action import Action
from .backend_task import BackendTask


class FACESTAGE_OT_choose_landmarks(Action, bpy.types.Operator, ImportHelper):
    """Choose the photo's landmark file (landmarks.json)"""

    bl_idname = "facestage.choose_landmarks"
    bl_label = "Choose Landmarks"

    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    def act(self, context: bpy.types.Context) -> None:
        """Check the file and remember it."""
        choose_landmarks(context.scene, Path(self.filepath))


class FACESTAGE_OT_detect_landmarks(BackendTask, bpy.types.Operator):
    """Find the face in the photo and show its landmarks as points that you can drag"""

    bl_idname = "facestage.detect_landmarks"
    bl_label = "Detect Landmarks"
    bl_options = {"REGISTER", "UNDO"}

    task = "Looking for the face"
    out = Path()

    def command(self, context: bpy.types.Context) -> list[str]:
        """Ask the backend for the landmarks of the chosen face."""
        scene = context.scene
        photo = require_photo(scene)
        self.out = free_path(work_folder(scene), DETECTED)
        return detect_command(
            backend_command(context), photo, self.out, scene.facestage.face_number
        )

    def finish(self, context: bpy.types.Context, _process: BackendProcess) -> None:
        """Remember the landmarks and show them."""
        scene = context.scene
        landmarks = Landmarks.read(self.out)
        width, height = load_image(require_photo(scene)).size
        landmarks.check_inside(width, height)
        scene.facestage.landmarks, scene.facestage.landmarks_from = str(self.out), "DETECTED"
        aim_camera(scene)
        look_at_face(context, empties.show_landmarks(scene, landmarks, width, height), landmarks)

    def _end(
        self, context: bpy.types.Context, process: BackendProcess, outcome: Outcome
    ) -> set[str]:
        verdict = super()._end(context, process, outcome)
        if verdict == {"FINISHED"}:
            ready_to_drag(context)
        return verdict


class FACESTAGE_OT_forget_landmarks(Action, bpy.types.Operator):
    """Forget the landmarks of the photo: the fit finds them by itself"""

    bl_idname = "facestage.forget_landmarks"
    bl_label = "Forget Landmarks"

    def act(self, context: bpy.types.Context) -> None:
        """Leave the landmarks to the backend."""
        forget_landmarks(context.scene)


class FACESTAGE_OT_edit_landmarks(Action, bpy.types.Operator):
    """Shows the landmarks as points on the photo."""

    bl_idname = "facestage.edit_landmarks"
    bl_label = "Edit Landmarks"
    bl_description = (
        "Show the landmarks on the photo as points that you can drag (G). The ones between them "
        "follow"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Show the points."""
        edit_landmarks(context.scene)

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Show the points, ready to be dragged."""
        verdict = super().execute(context)
        if verdict == {"FINISHED"}:
            plane = empties.require_plane(context.scene)
            look_at_face(context, plane, empties.base_landmarks(plane))
            ready_to_drag(context)
        return verdict


class FACESTAGE_OT_landmark_state(Action, bpy.types.Operator):
    """Say what the fit makes of the selected landmarks"""

    bl_idname = "facestage.landmark_state"
    bl_label = "Mark Landmarks"

    state: EnumProperty(
        name="State",
        description="What the fit makes of the selected landmarks",
        items=[
            (empties.VISIBLE, "Visible", "The photo shows these points of the face"),
            (
                empties.HIDDEN,
                "Hidden",
                "Something hides these points: where they are is a guess, which counts less",
            ),
            (empties.IGNORED, "Ignored", "The fit does not look at these landmarks"),
        ],
    )

    def act(self, context: bpy.types.Context) -> None:
        """Mark the selected landmarks."""
        selected = [item for item in context.view_layer.objects if item.select_get()]
        mark_landmarks(context.scene, selected, self.state)


class FACESTAGE_OT_done_landmarks(Action, bpy.types.Operator):
    """Ends the editing of the landmarks."""

    bl_idname = "facestage.done_landmarks"
    bl_label = "Done"
    bl_description = (
        "Keep the landmarks as they are now: they are written to a file of their own, and the "
        "points go away"
    )

    def act(self, context: bpy.types.Context) -> None:
        """Write the landmarks."""
        keep_landmarks(context.scene)


class FACESTAGE_OT_revert_landmarks(Action, bpy.types.Operator):
    """Put all landmarks back to where they were when you began to edit them"""

    bl_idname = "facestage.revert_landmarks"
    bl_label = "Revert"

    def act(self, context: bpy.types.Context) -> None:
        """Make the points anew."""
        plane = empties.require_plane(context.scene)
        empties.show_landmarks(context.scene, empties.base_landmarks(plane), *photo_size(plane))


def ready_to_drag(context: bpy.types.Context) -> None:
    """Only in object mode can objects be clicked."""
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


CLASSES = (
    FACESTAGE_OT_choose_landmarks,
    FACESTAGE_OT_detect_landmarks,
    FACESTAGE_OT_forget_landmarks,
    FACESTAGE_OT_edit_landmarks,
    FACESTAGE_OT_landmark_state,
    FACESTAGE_OT_done_landmarks,
    FACESTAGE_OT_revert_landmarks,
)
