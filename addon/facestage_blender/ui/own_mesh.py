"""A mesh of the user's as the face: Use My Mesh, Mark Landmark, and their panel."""

from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import bpy
from bpy.props import EnumProperty, IntProperty

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.rig_file import MARKS, RigFile

from ..rig.control.control_rig import renewal_steps
from ..rig.own_lines import show_lines
from ..rig.own_marks import MARK_GROUP, clear_mark, mark
from ..rig.own_record import OwnMesh
from ..rig.own_rig import adopt, export_mesh
from ..scene.paths import work_folder
from ..scene.stage import ensure_stage
from ..scene.user_state import preserved
from ..skin.material import paint_albedo
from ..translations import said
from .action import Action
from .backend_task import ModelTask
from .sidebar import SidebarPanel, draw_task

MARK_ITEMS = [
    (name, words, f"{words}; left and right are the face's own")
    for name, (words, _) in MARKS.items()
]


VERTEX = IntProperty(
    name="Vertex",
    description="Number of the vertex; -1: those that are selected",
    default=-1,
    min=-1,
    options={"SKIP_SAVE"},
)


def _active_mesh(context: bpy.types.Context) -> bpy.types.Object | None:
    item = context.view_layer.objects.active
    return item if item is not None and item.type == "MESH" else None


class _OnMesh:
    """Mixin of what needs an active mesh."""

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with an active mesh."""
        cls.poll_message_set("Make the mesh of a face active")  # type: ignore[attr-defined]
        return _active_mesh(context) is not None


class FACESTAGE_OT_use_my_mesh(ModelTask, bpy.types.Operator):
    """Makes the active mesh the face to fit."""

    bl_idname = "facestage.use_my_mesh"
    bl_label = "Use My Mesh"
    bl_description = (
        "Make the active mesh the face to fit: its shape keys become the sliders of the fit. "
        "The mesh is not moved yet; lines show where its landmarks were found, until a fit is "
        "applied"
    )
    bl_options = {"REGISTER", "UNDO"}

    task = "Finding the face on the mesh"
    exported: ClassVar[tuple[str, Path, RigFile, OwnMesh, list[str]] | None] = None

    def specification(self, context: bpy.types.Context) -> str:
        """Export the mesh: the backend makes a face model of it."""
        item = _active_mesh(context)
        with preserved(context.view_layer):
            exported = export_mesh(item, work_folder(context.scene))
        assert item is not None  # export_mesh has refused it otherwise
        FACESTAGE_OT_use_my_mesh.exported = (item.name, *exported)
        return f"rig:{exported[0]}"

    def use(self, context: bpy.types.Context, model: FaceModel) -> Iterator[None]:
        """Paint the skin, tie the mesh to its model, and build the stage when there is none; then
        the handles.
        """
        albedo = paint_albedo(model)
        yield
        assert self.exported is not None
        name, path, rig, own, notes = self.exported
        FACESTAGE_OT_use_my_mesh.exported = None
        scene = context.scene
        item = scene.objects.get(name)
        if item is None:
            raise InputError(
                f"The mesh '{name}' is gone; make the mesh of a face active and press Use My "
                "Mesh again."
            )
        ensure_stage(scene)
        adopt(scene, item, f"rig:{path}", model, rig, own, albedo)
        show_lines(item, model)
        yield
        yield from renewal_steps(scene)
        sliders = (
            f"{len(own.expression)} expressions, {len(own.identity) or len(model.identity_names)} "
            "shapes of faces"
        )
        self.report({"INFO"}, "; ".join([f"'{name}' is the face now: {sliders}", *notes]) + ".")


class FACESTAGE_OT_mark_landmark(_OnMesh, Action, bpy.types.Operator):
    """Say where a landmark is on the active mesh: at the middle of the selected vertices"""

    bl_idname = "facestage.mark_landmark"
    bl_label = "Mark Landmark"

    landmark: EnumProperty(
        name="Landmark", description="What the selected vertices are", items=MARK_ITEMS
    )
    vertex: VERTEX

    def act(self, context: bpy.types.Context) -> None:
        """Keep the selected vertices as the landmark's place."""
        mark(_active_mesh(context), self.landmark, None if self.vertex < 0 else self.vertex)


class FACESTAGE_OT_clear_landmark(_OnMesh, Action, bpy.types.Operator):
    """Forget where this landmark is on the active mesh"""

    bl_idname = "facestage.clear_landmark"
    bl_label = "Clear Landmark"

    landmark: EnumProperty(
        name="Landmark", description="Which landmark to forget", items=MARK_ITEMS
    )

    def act(self, context: bpy.types.Context) -> None:
        """Remove the landmark's mark."""
        clear_mark(_active_mesh(context), self.landmark)


class FACESTAGE_PT_own_mesh(SidebarPanel, bpy.types.Panel):
    """A mesh of the user's as the face."""

    bl_label = "My Own Mesh"
    bl_parent_id = "FACESTAGE_PT_face"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what is asked of the active mesh, and the button that makes it the face."""
        layout, item = self.layout, _active_mesh(context)
        if item is None:
            layout.label(text="Make the mesh of a face active", icon="INFO")
            return
        face = item.facestage_face
        used = bool(face.own_mesh) and context.scene.facestage.rig == item
        layout.label(
            text=said("{name} is the face", name=item.name) if used else item.name,
            icon="CHECKMARK" if used else "MESH_DATA",
        )
        column = layout.column(align=True)
        column.prop(face, "fit_shape")
        column.prop(face, "own_materials")
        _draw_split(layout, face, "identity_prefix", said("Identity Sliders"))
        materials = [slot.material for slot in item.material_slots if slot.material is not None]
        if materials:
            column = layout.column(align=True)
            for material in materials:
                _draw_split(column, material, "facestage_part", material.name, "MATERIAL")
        if not draw_task(layout, context, FACESTAGE_OT_use_my_mesh.task):
            layout.operator("facestage.use_my_mesh", icon="FILE_REFRESH" if used else "ADD")


def _draw_split(
    layout: bpy.types.UILayout, owner: object, name: str, label: str, icon: str = "NONE"
) -> None:
    """A setting with more room for its label than Blender gives one in a sidebar."""
    row = layout.split(factor=0.55, align=True)
    row.label(text=label, icon=icon, translate=False)
    row.prop(owner, name, text="")


class FACESTAGE_PT_mesh_landmarks(_OnMesh, SidebarPanel, bpy.types.Panel):
    """Landmarks of a mesh of the user's, all of them optional."""

    bl_label = "Landmarks on the Mesh"
    bl_parent_id = "FACESTAGE_PT_own_mesh"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context: bpy.types.Context) -> None:
        """Draw a row for each landmark, ticked where it is marked."""
        item = _active_mesh(context)
        assert item is not None  # poll has seen to it
        self.layout.label(text="Select a vertex, then its name", icon="INFO")
        column = self.layout.column(align=True)
        for name, (words, _) in MARKS.items():
            marked = MARK_GROUP + name in item.vertex_groups
            row = column.row(align=True)
            row.operator(
                "facestage.mark_landmark",
                text=words,
                icon="CHECKBOX_HLT" if marked else "CHECKBOX_DEHLT",
            ).landmark = name
            if marked:
                row.operator("facestage.clear_landmark", text="", icon="X").landmark = name


CLASSES = (
    FACESTAGE_OT_use_my_mesh,
    FACESTAGE_OT_mark_landmark,
    FACESTAGE_OT_clear_landmark,
    FACESTAGE_PT_own_mesh,
    FACESTAGE_PT_mesh_landmarks,
)
