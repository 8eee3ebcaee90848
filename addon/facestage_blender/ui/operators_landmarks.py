"""What the user does with landmarks: have them found, edit them on the photo, keep or revert the
edit.
"""

from pathlib import Path

import bpy
from bpy.props import EnumProperty

from facestage.contract.errors import InputError
from facestage.contract.files.storage import write_json
from facestage.contract.landmarks import Landmarks

from ..backend.commands import detect_command
from ..backend.process import BackendProcess, Outcome
from ..exchange.scene_read import read_landmarks
from ..landmarks import empties as shown
from ..landmarks.photo_view import look_at_face
from ..landmarks.plane import photo_size
from ..pictures.images import load_image
from ..preferences import backend_command
from ..scene.paths import absolute, work_folder
from .operators import forget_landmarks, reported
from .operators_fit import BackendTask

DETECTED, EDITED = "landmarks_detected", "landmarks_edited"


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
        look_at_face(context, shown.show_landmarks(scene, landmarks, width, height), landmarks)

    def _end(
        self, context: bpy.types.Context, process: BackendProcess, outcome: Outcome
    ) -> set[str]:
        verdict = super()._end(context, process, outcome)
        if verdict == {"FINISHED"}:
            ready_to_drag(context)
        return verdict


class FACESTAGE_OT_forget_landmarks(bpy.types.Operator):
    """Forget the landmarks of the photo: the fit finds them by itself"""

    bl_idname = "facestage.forget_landmarks"
    bl_label = "Forget Landmarks"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Leave the landmarks to the backend."""
        return reported(self, context, lambda: forget_landmarks(context.scene))


class FACESTAGE_OT_edit_landmarks(bpy.types.Operator):
    """Show the landmarks on the photo as points that you can drag (G).

    The ones between them follow
    """

    bl_idname = "facestage.edit_landmarks"
    bl_label = "Edit Landmarks"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Show the points, ready to be dragged."""
        verdict = reported(self, context, lambda: edit_landmarks(context.scene))
        if verdict == {"FINISHED"}:
            plane = shown.require_plane(context.scene)
            look_at_face(context, plane, shown.base_landmarks(plane))
            ready_to_drag(context)
        return verdict


class FACESTAGE_OT_landmark_state(bpy.types.Operator):
    """Say what the fit makes of the selected landmarks"""

    bl_idname = "facestage.landmark_state"
    bl_label = "Mark Landmarks"
    bl_options = {"REGISTER", "UNDO"}

    state: EnumProperty(
        name="State",
        description="What the fit makes of the selected landmarks",
        items=[
            (shown.VISIBLE, "Visible", "The photo shows these points of the face"),
            (
                shown.HIDDEN,
                "Hidden",
                "Something hides these points: where they are is a guess, which counts less",
            ),
            (shown.IGNORED, "Ignored", "The fit does not look at these landmarks"),
        ],
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Mark the selected landmarks."""
        selected = [item for item in context.view_layer.objects if item.select_get()]
        return reported(self, context, lambda: mark_landmarks(context.scene, selected, self.state))


class FACESTAGE_OT_done_landmarks(bpy.types.Operator):
    """Keep the landmarks as they are now: they are written to a file of their own, and the points
    go away
    """

    bl_idname = "facestage.done_landmarks"
    bl_label = "Done"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Write the landmarks."""
        return reported(self, context, lambda: keep_landmarks(context.scene))


class FACESTAGE_OT_revert_landmarks(bpy.types.Operator):
    """Put all landmarks back to where they were when you began to edit them"""

    bl_idname = "facestage.revert_landmarks"
    bl_label = "Revert"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Make the points anew."""

        def revert() -> None:
            plane = shown.require_plane(context.scene)
            shown.show_landmarks(context.scene, shown.base_landmarks(plane), *photo_size(plane))

        return reported(self, context, revert)


def edit_landmarks(scene: bpy.types.Scene) -> None:
    """Show the landmarks of the scene's file on its photo.

    Raises InputError when there are none.
    """
    if not scene.facestage.landmarks:
        raise InputError(
            "There are no landmarks to edit; press Detect Landmarks, or choose a landmark file."
        )
    width, height = load_image(require_photo(scene)).size
    shown.remove_landmarks(scene)
    landmarks = read_landmarks(scene, width, height)
    assert landmarks is not None  # the scene names a file
    shown.show_landmarks(scene, landmarks, width, height)


def keep_landmarks(scene: bpy.types.Scene) -> None:
    """Write the landmarks as the empties show them, unless nothing was changed, and take the
    empties away.

    A file that was there is left alone, so that undo leads back to what it held.
    """
    plane = shown.require_plane(scene)
    landmarks = read_landmarks(scene, *photo_size(plane))
    assert landmarks is not None  # they are shown
    if landmarks.to_json() != shown.base_landmarks(plane).to_json():
        path = free_path(work_folder(scene), EDITED)
        write_json(path, landmarks.to_json())
        scene.facestage.landmarks, scene.facestage.landmarks_from = str(path), "EDITED"
    shown.remove_landmarks(scene)


def mark_landmarks(scene: bpy.types.Scene, selected: list[bpy.types.Object], state: str) -> None:
    """Set the state of the landmarks among the selected objects.

    Raises InputError when there is none.
    """
    empties = [item for item in shown.landmark_empties(scene) if item in selected]
    if not empties:
        raise InputError("No landmark is selected; click one of the points on the photo first.")
    for empty in empties:
        empty.facestage_landmark.state = state


def require_photo(scene: bpy.types.Scene) -> Path:
    """The photo's file. Raises InputError when none is chosen."""
    if not scene.facestage.photo:
        raise InputError("No photo is chosen; press Choose Photo first.")
    return absolute(scene.facestage.photo)


def free_path(folder: Path, stem: str) -> Path:
    """The first of STEM.json, STEM_2.json, ... in ``folder`` that is not there yet."""
    path, number = folder / f"{stem}.json", 2
    while path.exists():
        path, number = folder / f"{stem}_{number}.json", number + 1
    return path


def ready_to_drag(context: bpy.types.Context) -> None:
    """Only in object mode can objects be clicked."""
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")


CLASSES = (
    FACESTAGE_OT_detect_landmarks,
    FACESTAGE_OT_forget_landmarks,
    FACESTAGE_OT_edit_landmarks,
    FACESTAGE_OT_landmark_state,
    FACESTAGE_OT_done_landmarks,
    FACESTAGE_OT_revert_landmarks,
)
