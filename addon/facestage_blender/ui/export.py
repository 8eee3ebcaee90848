"""Step 5: the face as a file for other programs, and as an asset for other .blend files."""

from pathlib import Path
from typing import ClassVar

import bpy
from bpy.props import BoolProperty, EnumProperty, StringProperty
from bpy_extras.io_utils import ExportHelper

from ..exchange.asset import asset_of, clear_asset, mark_as_asset
from ..exchange.export import FORMATS, export_face
from ..rig.face_rig import require_rig
from ..scene.paths import absolute
from .action import Action, Toggle

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


class FACESTAGE_OT_mark_as_asset(Toggle, bpy.types.Operator):
    """Marks the face for the Asset Browser."""

    bl_idname = "facestage.mark_as_asset"
    bl_label = "Mark as Asset"
    bl_description = (
        "Let the Asset Browser show the face, with a picture of the fit, to be dragged into other "
        "files: its rig, what grows on it and its handles, without lights and camera; again: none"
    )

    name: StringProperty(
        name="Name",
        description="What the Asset Browser calls the face; empty: as its rig is called",
        options={"SKIP_SAVE"},
    )

    def is_on(self, context: bpy.types.Context) -> bool:
        """Whether it is an asset."""
        return asset_of(require_rig(context.scene)) is not None

    def act(self, context: bpy.types.Context) -> None:
        """Asked to be one that it is already, it is brought up to date."""
        if self.state == "ON":
            self.turn(context, True)
        else:
            super().act(context)

    def turn(self, context: bpy.types.Context, on: bool) -> None:
        """Mark it, or no more."""
        if not on:
            clear_asset(require_rig(context.scene))
            return
        mark_as_asset(context.scene, self.name)
        if not bpy.data.filepath:
            self.report({"INFO"}, "Save the .blend: the Asset Browser shows only saved files.")


CLASSES = (FACESTAGE_OT_export, FACESTAGE_OT_mark_as_asset)
