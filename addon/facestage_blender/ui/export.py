"""Step 5: the face as a file for other programs."""

from pathlib import Path
from typing import ClassVar

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..exchange.export import FORMATS, export_face
from ..scene.paths import absolute
from .action import Action

AS_FITTED = "0"
HELP = {
    "GLB": "One file with its textures: game engines, the web, most viewers",
    "FBX": "One file with its textures: game engines, Maya, 3ds Max",
    "USD": "A file, and its textures in a folder beside it: film pipelines, Houdini, Omniverse",
    "OBJ": "The shape as it is now, without sliders, and its textures in a folder beside it",
}


class FACESTAGE_OT_export(Action, bpy.types.Operator, ExportHelper):
    """Asks for the file."""

    bl_idname = "facestage.export"
    bl_label = "Export Face"
    bl_description = (
        "Save the face for another program: its shape, its expressions as shape keys, and a plain "
        "material with ordinary textures"
    )
    bl_options: ClassVar[set[str]] = set()

    filepath: StringProperty(subtype="FILE_PATH", description="The file to write")
    filename_ext = FORMATS["GLB"].suffix
    filter_glob: StringProperty(
        default=";".join(f"*{kind.suffix}" for kind in FORMATS.values()), options={"HIDDEN"}
    )
    kind: EnumProperty(
        name="Format",
        description="The kind of file",
        items=[(name, kind.title, HELP[name]) for name, kind in FORMATS.items()],
    )
    side: EnumProperty(
        name="Textures",
        description="The most pixels along a side of a texture",
        items=[
            (AS_FITTED, "As Fitted", "As many pixels as the fit painted"),
            *((str(n), str(n), f"At most {n} by {n} pixels") for n in (512, 1024, 2048, 4096)),
        ],
    )
    in_place: BoolProperty(
        name="Keep Pose",
        description="The head stands where it stands in the scene; otherwise upright in the origin",
    )

    def check(self, context: bpy.types.Context) -> bool:
        """Give the name the ending of the format."""
        named = str(Path(self.filepath).with_suffix(FORMATS[self.kind].suffix))
        changed, self.filepath = named != self.filepath, named
        return changed

    def act(self, context: bpy.types.Context) -> None:
        """Write the file."""
        side = None if self.side == AS_FITTED else int(self.side)
        files = export_face(context.scene, absolute(self.filepath), side, self.in_place)
        self.report({"INFO"}, f"Exported {', '.join(each.name for each in files)}.")


CLASSES = (FACESTAGE_OT_export,)
