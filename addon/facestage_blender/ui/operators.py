"""What the user can do at once: build the stage, choose files, apply a result, relight.

Each calls one function.
"""

from collections.abc import Callable
from pathlib import Path

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from facestage.contract.errors import FacestageError, InputError
from facestage.contract.files.paths import is_file
from facestage.contract.landmarks import Landmarks
from facestage.contract.result import Result

from ..exchange.write_back import apply_result
from ..landmarks.empties import remove_landmarks
from ..scene.camera import ensure_camera, show_photo
from ..scene.frames import LIGHT_DIRECTIONS
from ..scene.paths import absolute, result_folder
from ..scene.relight import relight, restore_lights
from ..scene.stage import (
    build_stage,
    default_stage,
    facestage_collection,
    require_stage,
    stage_lights,
)
from ..scene.user_state import preserved

REPORT = "report.html"


def reported(
    operator: bpy.types.Operator, context: bpy.types.Context, action: Callable[[], object]
) -> set[str]:
    """Run an action with the user's mode and selection preserved; a user's error becomes the
    operator's report.
    """
    try:
        with preserved(context.view_layer):
            action()
    except FacestageError as error:
        operator.report({"ERROR"}, str(error))
        return {"CANCELLED"}
    return {"FINISHED"}


class FACESTAGE_OT_build_stage(bpy.types.Operator):
    """Build the light stage: square area lights on a hemisphere around the face.

    Resets the lights that exist
    """

    bl_idname = "facestage.build_stage"
    bl_label = "Build Light Stage"
    bl_options = {"REGISTER", "UNDO"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Build the stage as the scene's settings say."""
        settings = context.scene.facestage

        def build() -> None:
            stage = default_stage(settings.light_count, settings.light_radius, settings.light_side)
            build_stage(context.scene, stage)

        return reported(self, context, build)


class FACESTAGE_OT_choose_photo(bpy.types.Operator, ImportHelper):
    """Choose the photo.

    It is shown behind the camera's view; renders get its size and no tone curve
    """

    bl_idname = "facestage.choose_photo"
    bl_label = "Choose Photo"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default="*.png;*.jpg;*.jpeg;*.exr", options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Remember the photo and show it."""
        return reported(self, context, lambda: choose_photo(context.scene, Path(self.filepath)))


class FACESTAGE_OT_choose_landmarks(bpy.types.Operator, ImportHelper):
    """Choose the photo's landmark file (landmarks.json)"""

    bl_idname = "facestage.choose_landmarks"
    bl_label = "Choose Landmarks"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: StringProperty(default="*.json", options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Check the file and remember it."""
        return reported(self, context, lambda: choose_landmarks(context.scene, Path(self.filepath)))


class FACESTAGE_OT_apply_result(bpy.types.Operator):
    """Put the last fit into the scene: sliders, pose, textures, lights and camera, as one undo
    step
    """

    bl_idname = "facestage.apply_result"
    bl_label = "Apply Result"
    bl_options = {"REGISTER", "UNDO"}

    folder: StringProperty(
        name="Folder",
        description="Result folder; empty: the last fit's",
        subtype="DIR_PATH",
        options={"SKIP_SAVE"},
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Load the result and apply it."""

        def apply() -> None:
            apply_result(context.scene, Result.load(result_folder(context.scene, self.folder)))

        return reported(self, context, apply)


class FACESTAGE_OT_open_report(bpy.types.Operator):
    """Open the last fit's report in the web browser"""

    bl_idname = "facestage.open_report"
    bl_label = "Open Report"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Open the report of the last result."""
        try:
            report = result_folder(context.scene) / REPORT
            if not is_file(report):
                raise InputError(f"There is no report at '{report}'; run a fit first.")
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        bpy.ops.wm.url_open(url=report.as_uri())
        return {"FINISHED"}


class FACESTAGE_OT_relight(bpy.types.Operator):
    """Light the face from one side with white light, or return to the fitted lights"""

    bl_idname = "facestage.relight"
    bl_label = "Relight"
    bl_options = {"REGISTER", "UNDO"}

    direction: EnumProperty(
        name="From",
        description="Where the light comes from, as seen in the picture",
        items=[("fitted", "As fitted", "The lights that the fit found")]
        + [(name, name.capitalize(), f"Light from the {name}") for name in LIGHT_DIRECTIONS],
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Change the lights' colors and powers."""
        if self.direction == "fitted":
            return reported(self, context, lambda: restore_lights(context.scene))
        return reported(self, context, lambda: relight(context.scene, self.direction))


class FACESTAGE_OT_light_states(bpy.types.Operator):
    """Set what the fit may do with all lights at once"""

    bl_idname = "facestage.light_states"
    bl_label = "Set All Lights"
    bl_options = {"REGISTER", "UNDO"}

    state: EnumProperty(
        name="State",
        description="What the fit does with every light",
        items=[
            ("ON", "All Fitted", "The fit finds the color and power of every light"),
            ("FROZEN", "All Frozen", "Every light keeps its color and power"),
            ("OFF", "All Off", "Every light is dark"),
        ],
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Set the state of every light."""

        def set_all() -> None:
            for light in stage_lights(require_stage(context.scene)):
                light.facestage_light.state = self.state

        return reported(self, context, set_all)


def choose_photo(scene: bpy.types.Scene, path: Path) -> None:
    """Make ``path`` the scene's photo and show it behind the camera.

    Raises InputError when it is no picture.
    """
    path, settings = absolute(str(path)), scene.facestage
    show_photo(scene, ensure_camera(scene, facestage_collection(scene)), path)
    if settings.photo and absolute(settings.photo) != path:
        forget_landmarks(scene)  # they are of the photo before
    settings.photo = str(path)


def choose_landmarks(scene: bpy.types.Scene, path: Path) -> None:
    """Make ``path`` the photo's landmark file. Raises InputError when it is not one."""
    path = absolute(str(path))
    Landmarks.read(path)
    forget_landmarks(scene)
    scene.facestage.landmarks = str(path)


def forget_landmarks(scene: bpy.types.Scene) -> None:
    """Leave the landmarks of the photo to the backend."""
    remove_landmarks(scene)
    scene.facestage.landmarks = ""
    scene.facestage.property_unset("landmarks_from")


CLASSES = (
    FACESTAGE_OT_build_stage,
    FACESTAGE_OT_choose_photo,
    FACESTAGE_OT_choose_landmarks,
    FACESTAGE_OT_apply_result,
    FACESTAGE_OT_open_report,
    FACESTAGE_OT_relight,
    FACESTAGE_OT_light_states,
)
