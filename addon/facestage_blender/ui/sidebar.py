"""What the panels of Facestage's sidebar have in common."""

from collections.abc import Callable
from pathlib import Path

import bpy

from facestage.contract.errors import InputError

from ..preferences import draw_wrapped

EDGES = 98.0  # pixels of the sidebar, at a scale of 1, beside what a box in it says after its icon


class SidebarPanel:
    """Where all panels of Facestage live."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Facestage"


def existing(folder: Callable[[bpy.types.Scene], Path], scene: bpy.types.Scene) -> Path | None:
    """A folder of the scene's; None where what is set can be none: the operators say what is wrong,
    a panel draws.
    """
    try:
        return folder(scene)
    except InputError:
        return None


def draw_task(layout: bpy.types.UILayout, context: bpy.types.Context, *tasks: str) -> bool:
    """What a step shows of its tasks: the progress of the one that runs (then True), else why the
    last one ended without a result.
    """
    state = context.window_manager.facestage
    if state.task and state.task in tasks:
        draw_progress(layout, state)
        return True
    if not state.task and state.began in tasks and (state.failure or state.notice):
        text, icon = (state.failure, "ERROR") if state.failure else (state.notice, "INFO")
        draw_wrapped(layout.box(), text, icon, line_width(context))
    return False


def draw_progress(layout: bpy.types.UILayout, state: bpy.types.PropertyGroup) -> None:
    """The running task's bar, what it says of itself, and Cancel."""
    text = f"{state.task}: {state.stage}" if state.stage else state.task
    row = layout.row(align=True)
    if hasattr(row, "progress"):
        row.progress(text=f"{state.fraction:.0%}  {text}", factor=state.fraction, type="BAR")
    else:
        row.prop(state, "fraction", text=text, slider=True)
    row.operator("facestage.cancel", icon="CANCEL", text="")
    details = []
    if state.photo_error >= 0:
        details.append(f"photo error {state.photo_error:.4f}")
    if state.seconds_left >= 0:
        details.append(f"about {state.seconds_left:.0f} s left")
    if state.cancel:
        details = ["Stopping ..."]
    if details:
        layout.label(text=", ".join(details), icon="TIME")


def line_width(context: bpy.types.Context) -> float:
    """How many pixels a line of the sidebar has for words."""
    return float(context.region.width - EDGES * context.preferences.system.ui_scale)
