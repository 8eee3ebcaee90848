"""What shows the face relit while the lights are edited: turn the preview on and off, prepare
it.
"""

import bpy

from facestage.contract.errors import FacestageError

from ..backend.commands import render_command
from ..backend.process import BackendProcess
from ..preferences import backend_command
from ..preview import live as preview
from ..scene.paths import result_folder
from .operators_fit import BackendTask


class FACESTAGE_OT_relight_preview(bpy.types.Operator):
    """Show the photo relit over the camera's view while you change colors, powers and states of the
    lights
    """

    bl_idname = "facestage.relight_preview"
    bl_label = "Relight Preview"

    def execute(self, context: bpy.types.Context) -> set[str]:
        """Turn the preview on, or off when it is on."""
        if preview.Preview.photo is not None:
            preview.stop()
            return {"FINISHED"}
        try:
            preview.start(context.scene)
        except FacestageError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}


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
        preview.start(context.scene)


CLASSES = (FACESTAGE_OT_relight_preview, FACESTAGE_OT_prepare_relight)
