"""Step 3: the face model, and the rig that is built from it."""

from collections.abc import Iterator

import bpy
from bpy.props import EnumProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from facestage.contract.face_model import FaceModel
from facestage.contract.job import DEFAULT_MODEL

from ..drawing import draw_wrapped
from ..pins.aiming import aim_camera
from ..rig.control.control_rig import renewal_steps
from ..rig.face_rig import build_rig
from ..rig.model_kinds import KINDS, choose_model, model_label, model_license
from ..scene.stage import ensure_stage
from ..skin.material import paint_albedo
from ..translations import said
from .action import Action
from .backend_task import ModelTask
from .sidebar import SidebarPanel, draw_task, line_width


class FACESTAGE_OT_build_rig(ModelTask, bpy.types.Operator):
    """Builds the face rig of the chosen model."""

    bl_idname = "facestage.build_rig"
    bl_label = "Build Face Rig"
    bl_description = (
        "Build the face rig: a mesh with identity and expression sliders and a skin material. "
        "Replaces the present one"
    )
    bl_options = {"REGISTER", "UNDO"}

    task = "Loading the face model"

    def specification(self, context: bpy.types.Context) -> str:
        """The model that the user has chosen."""
        return str(context.scene.facestage.model)

    def use(self, context: bpy.types.Context, model: FaceModel) -> Iterator[None]:
        """Paint the skin, build the rig, and the stage when there is none; then the handles."""
        albedo = paint_albedo(model)
        yield
        scene = context.scene
        build_rig(scene, model, scene.facestage.model, ensure_stage(scene), albedo)
        yield
        yield from renewal_steps(scene)
        yield
        aim_camera(scene)


class FACESTAGE_OT_choose_model(Action, bpy.types.Operator, ImportHelper):
    """Choose the face model that the rig is built from"""

    bl_idname = "facestage.choose_model"
    bl_label = "Choose Face Model"

    kind: EnumProperty(
        name="Kind",
        description="Kind of face model",
        items=[
            (name, kind.label, f"{kind.help}. License: {kind.license}")
            for name, kind in KINDS.items()
        ],
    )
    filter_glob: StringProperty(default="*", options={"HIDDEN", "SKIP_SAVE"})

    @classmethod
    def description(
        cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties
    ) -> str:
        """The tooltip: what this kind is, and under which license."""
        kind = KINDS[properties.kind]
        return f"{kind.help}. License: {kind.license}"

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask for the file; the built-in head needs none."""
        if self.kind == DEFAULT_MODEL:
            return self.execute(context)
        self.filter_glob = KINDS[self.kind].patterns
        return ImportHelper.invoke(self, context, event)

    def act(self, context: bpy.types.Context) -> None:
        """Remember the model."""
        choose_model(context.scene, self.kind, self.filepath)


class FACESTAGE_MT_model(bpy.types.Menu):
    """The kinds of face models."""

    bl_idname = "FACESTAGE_MT_model"
    bl_label = "Face Model"
    bl_description = "Choose the face model that the rig is built from"

    def draw(self, _context: bpy.types.Context) -> None:
        """One entry for each kind."""
        for name, kind in KINDS.items():
            text = kind.label if name == DEFAULT_MODEL else f"{kind.label} ..."
            self.layout.operator("facestage.choose_model", text=text, icon=kind.icon).kind = name


class FACESTAGE_PT_face(SidebarPanel, bpy.types.Panel):
    """Step 3: the face rig."""

    bl_label = "3  Face"

    def draw_header(self, _context: bpy.types.Context) -> None:
        """Draw the step's icon."""
        self.layout.label(icon="USER")

    def draw(self, context: bpy.types.Context) -> None:
        """Draw the choice of model and the rig's builder."""
        layout, settings = self.layout, context.scene.facestage
        layout.menu("FACESTAGE_MT_model", text=model_label(settings.model), icon="USER")
        draw_wrapped(
            layout,
            said("License: {license}", license=model_license(context.scene)),
            "NONE",
            line_width(context),
        )
        if draw_task(layout, context, FACESTAGE_OT_build_rig.task):
            return
        built = settings.rig is not None
        layout.operator(
            "facestage.build_rig",
            icon="FILE_REFRESH" if built else "ADD",
            text="Rebuild Face Rig" if built else None,
        )
        if built:
            layout.operator("facestage.add_face", icon="COMMUNITY")


CLASSES = (FACESTAGE_OT_build_rig, FACESTAGE_OT_choose_model, FACESTAGE_MT_model, FACESTAGE_PT_face)
