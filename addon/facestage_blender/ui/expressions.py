"""Step 5: the expressions, by region, below the result."""

from typing import ClassVar

import bpy
from bpy.props import EnumProperty

from facestage.contract.result import Result

from ..rig.expressions import FURTHER, REGIONS, as_fitted, expression_keys, mirror, neutral
from ..rig.face_rig import require_rig
from ..scene.paths import result_folder
from .action import Action
from .sidebar import SidebarPanel


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

    def draw(self, _context: bpy.types.Context) -> None:
        """Draw what moves all sliders."""
        row = self.layout.row(align=True)
        for to, text in (("NEUTRAL", "Neutral"), ("FITTED", "As Fitted"), ("MIRROR", "Mirror")):
            row.operator("facestage.set_expression", text=text).to = to


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
            column.prop(key, "value", text=key.name, slider=True)


def _panel(region: str) -> type:
    name = f"FACESTAGE_PT_expressions_{region.split()[0].lower()}"
    about = {"__doc__": f"{region}: its sliders.", "bl_label": region, "bl_idname": name}
    return type(name, (_Region, bpy.types.Panel), about)


CLASSES = (
    FACESTAGE_OT_set_expression,
    FACESTAGE_PT_expressions,
    *(_panel(region) for region in (*REGIONS, FURTHER)),
)
