"""Step 5: the expressions, by region, below the result."""

from typing import ClassVar

import bpy
from bpy.props import BoolProperty, EnumProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from facestage.contract.corrections import write_corrections
from facestage.contract.live_link import read_recording
from facestage.contract.result import Result
from facestage.contract.sequence import Sequence

from ..backend.commands import refit_command
from ..backend.process import BackendProcess
from ..exchange.corrections import corrected_performance, film_numbers, key_again
from ..exchange.live_link import key_recording
from ..exchange.performance import apply_performance
from ..landmarks.photo_view import look_through_camera
from ..preferences import backend_command, expression_folder
from ..rig.expressions import FURTHER, REGIONS, as_fitted, expression_keys, mirror, neutral
from ..rig.face_rig import require_rig
from ..rig.keyframes import key_handles, key_now
from ..rig.presets import BUILT_IN, apply_preset, forget_preset, keep_preset, preset_names
from ..rig.sliders import draw_slider
from ..scene.paths import CORRECTIONS, absolute, result_folder, work_folder
from ..translations import said
from .action import Action
from .backend_task import BackendTask
from .sidebar import SidebarPanel, draw_task


class FACESTAGE_OT_set_expression(Action, bpy.types.Operator):
    """Move all expression sliders at once"""

    bl_idname = "facestage.set_expression"
    bl_label = "Set Expression"

    to: EnumProperty(
        name="To",
        description="What the sliders move to",
        items=[
            ("NEUTRAL", "Neutral", "All expression sliders at rest"),
            ("FITTED", "As Fitted", "The expression of the photo, as the last fit found it"),
            ("MIRROR", "Mirror", "Left and right exchanged"),
        ],
    )

    @classmethod
    def description(
        cls, _context: bpy.types.Context, properties: bpy.types.OperatorProperties
    ) -> str:
        """The tooltip of each button."""
        items = cls.bl_rna.properties["to"].enum_items
        return str(items[properties.to].description)

    def act(self, context: bpy.types.Context) -> None:
        """Move them."""
        rig = require_rig(context.scene)
        if self.to == "NEUTRAL":
            neutral(rig)
        elif self.to == "MIRROR":
            mirror(rig)
        else:
            result = Result.load(result_folder(context.scene))
            as_fitted(rig, dict(zip(result.expression_names, result.expression, strict=True)))


class FACESTAGE_OT_apply_expression(Action, bpy.types.Operator):
    """Give the face this expression; all other expression sliders come to rest"""

    bl_idname = "facestage.apply_expression"
    bl_label = "Apply Expression"

    name: StringProperty(name="Name", description="Smile, for example, or one of your own")

    def act(self, context: bpy.types.Context) -> None:
        """Move the sliders."""
        apply_preset(require_rig(context.scene), self.name, expression_folder())


class FACESTAGE_OT_keep_expression(Action, bpy.types.Operator):
    """Keep the present expression under a name, for this face and others"""

    bl_idname = "facestage.keep_expression"
    bl_label = "Keep Expression"

    name: StringProperty(name="Name", description="What the menu shows", default="Mine")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the name."""
        return context.window_manager.invoke_props_dialog(self)

    def act(self, context: bpy.types.Context) -> None:
        """Write it."""
        keep_preset(require_rig(context.scene), self.name, expression_folder())


class FACESTAGE_OT_forget_expression(Action, bpy.types.Operator):
    """Delete this expression of yours"""

    bl_idname = "facestage.forget_expression"
    bl_label = "Forget Expression"

    name: StringProperty(name="Name", description="One of your own")

    def act(self, _context: bpy.types.Context) -> None:
        """Delete its file."""
        forget_preset(self.name, expression_folder())


class FACESTAGE_OT_key_expression(Action, bpy.types.Operator):
    """Key all expression sliders, and the handles of a control rig, at the present frame"""

    bl_idname = "facestage.key_expression"
    bl_label = "Key All"

    def act(self, context: bpy.types.Context) -> None:
        """Insert the keys."""
        rig = require_rig(context.scene)
        regions = expression_keys(rig).values()
        key_now([key for keys in regions for key in keys], context.scene.frame_current)
        key_handles(rig, context.scene.frame_current)


class FACESTAGE_OT_import_live_link(Action, bpy.types.Operator, ImportHelper):
    """Asks for a phone's recording."""

    bl_idname = "facestage.import_live_link"
    bl_label = "Import Live Link Face"
    bl_description = (
        "Key the expressions as a phone recorded them (the .csv of Live Link Face), from the "
        "present frame on and at the scene's frame rate"
    )

    filter_glob: StringProperty(default="*.csv", options={"HIDDEN"})

    def act(self, context: bpy.types.Context) -> None:
        """Read the file and write the keys."""
        rig = require_rig(context.scene)
        recording = read_recording(absolute(self.filepath))
        last = key_recording(context.scene, rig, recording)
        context.scene.frame_end = max(context.scene.frame_end, last)


class FACESTAGE_OT_import_performance(Action, bpy.types.Operator):
    """Asks for a folder of facestage track."""

    bl_idname = "facestage.import_performance"
    bl_label = "Import Performance"
    bl_description = (
        "Put the person of a film and the whole performance into the scene, from the present frame "
        "on: the folder that 'facestage track' wrote. Expressions, head and what changes of light "
        "and skin become keyframes"
    )

    directory: StringProperty(name="Folder", subtype="DIR_PATH", options={"SKIP_SAVE"})
    simplify: FloatProperty(
        name="Simplify",
        description="Leave keys out as long as every slider stays so near to the film, the head's "
        "turn within 10 degrees and its place within 100 mm times as much; 0: a key at each frame",
        min=0.0,
        max=1.0,
        precision=3,
        step=0.5,
        options={"SKIP_SAVE"},
    )
    filter_folder: BoolProperty(default=True, options={"HIDDEN", "SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        """Ask for the folder."""
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def act(self, context: bpy.types.Context) -> None:
        """Load the sequence and key it."""
        apply_performance(context.scene, Sequence.load(absolute(self.directory)), self.simplify)
        look_through_camera(context)


class FACESTAGE_OT_refit_performance(BackendTask, bpy.types.Operator):
    """Fits a film again around what was corrected."""

    bl_idname = "facestage.refit_performance"
    bl_label = "Refit Around Corrected Keys"
    bl_description = (
        "Fit the film again around the keys that you have changed since the performance was "
        "imported, sliders or head. They stay as they are, and the frames beside them follow"
    )
    bl_options = {"REGISTER", "UNDO"}

    task = "Fitting around corrected keys"
    _before: Sequence | None = None

    first: IntProperty(
        name="First",
        description="The first frame that may change; 0, and Last: half a second around the keys",
        options={"SKIP_SAVE"},
    )
    last: IntProperty(
        name="Last", description="The last frame that may change", options={"SKIP_SAVE"}
    )

    def command(self, context: bpy.types.Context) -> list[str]:
        """Write what was corrected and say where."""
        scene = context.scene
        backend, found = backend_command(context), corrected_performance(scene)
        self._before = found.sequence
        reach = None
        if self.first or self.last:
            start = scene.facestage.performance_start
            reach = film_numbers(found.sequence, start, self.first, self.last)
        path = work_folder(scene) / CORRECTIONS
        write_corrections(path, found.corrections)
        folder = absolute(scene.facestage.performance)
        return refit_command(backend, absolute(found.sequence.film), folder, path, reach)

    def finish(self, context: bpy.types.Context, _process: BackendProcess) -> None:
        """Key what has changed."""
        assert self._before is not None  # the command was made of it
        count = key_again(context.scene, self._before)
        self.report({"INFO"}, said("{count} frames follow your keys", count=count))


class FACESTAGE_MT_expressions(bpy.types.Menu):
    """Expressions by name."""

    bl_label = "Expressions"
    bl_description = "Expressions that come with Facestage, and your own"

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw the names."""
        column, own = self.layout.column(), preset_names(expression_folder())
        for name in (*BUILT_IN, None, *own):
            if name is None:
                column.separator()
            else:
                column.operator("facestage.apply_expression", text=name).name = name
        if own:
            column.separator()
        column.operator("facestage.keep_expression", text="Keep Expression...", icon="ADD")
        for name in own:
            forget = column.operator(
                "facestage.forget_expression", text=said("Forget {name}", name=name), icon="REMOVE"
            )
            forget.name = name


class FACESTAGE_PT_expressions(SidebarPanel, bpy.types.Panel):
    """The expressions of the face."""

    bl_label = "Expression"
    bl_parent_id = "FACESTAGE_PT_result"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only with a rig that has sliders."""
        rig = context.scene.facestage.rig
        return rig is not None and rig.data.shape_keys is not None

    def draw(self, context: bpy.types.Context) -> None:
        """Draw what moves all sliders, and what a film says of them."""
        row = self.layout.row(align=True)
        for to, text in (("NEUTRAL", "Neutral"), ("FITTED", "As Fitted"), ("MIRROR", "Mirror")):
            row.operator("facestage.set_expression", text=text).to = to
        self.layout.menu("FACESTAGE_MT_expressions")
        row = self.layout.row(align=True)
        row.operator("facestage.key_expression", icon="KEY_HLT")
        row.operator("facestage.import_live_link", icon="IMPORT", text="Live Link Face")
        self.layout.operator("facestage.import_performance", icon="FILE_MOVIE")
        if not context.scene.facestage.performance:
            return
        if not draw_task(self.layout, context, FACESTAGE_OT_refit_performance.task):
            self.layout.operator("facestage.refit_performance", icon="MOD_SMOOTH")


class _Region:
    """Mixin of a region's sliders."""

    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "Facestage"
    bl_parent_id = "FACESTAGE_PT_expressions"
    bl_label = ""
    bl_options: ClassVar[set[str]] = {"DEFAULT_CLOSED"}
    layout: bpy.types.UILayout

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only where the rig has such sliders."""
        rig = context.scene.facestage.rig
        return rig is not None and cls.bl_label in expression_keys(rig)

    def draw(self, context: bpy.types.Context) -> None:
        """Draw a slider for each expression of the region."""
        column = self.layout.column(align=True)
        for key in expression_keys(context.scene.facestage.rig).get(self.bl_label, []):
            draw_slider(column, key)


def _panel(region: str) -> type:
    name = f"FACESTAGE_PT_expressions_{region.split()[0].lower()}"
    about = {"__doc__": f"{region}: its sliders.", "bl_label": region, "bl_idname": name}
    return type(name, (_Region, bpy.types.Panel), about)


CLASSES = (
    FACESTAGE_OT_set_expression,
    FACESTAGE_OT_apply_expression,
    FACESTAGE_OT_keep_expression,
    FACESTAGE_OT_forget_expression,
    FACESTAGE_OT_key_expression,
    FACESTAGE_OT_import_live_link,
    FACESTAGE_OT_import_performance,
    FACESTAGE_OT_refit_performance,
    FACESTAGE_MT_expressions,
    FACESTAGE_PT_expressions,
    *(_panel(region) for region in (*REGIONS, FURTHER)),
)
