"""What the panels of Facestage's sidebar have in common."""

from collections.abc import Callable
from pathlib import Path

import bpy

from facestage.contract.errors import InputError

from ..drawing import draw_progress, draw_wrapped

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
        draw_progress(layout, state, line_width(context))
        return True
    if not state.task and state.began in tasks and (state.failure or state.notice):
        text, icon = (state.failure, "ERROR") if state.failure else (state.notice, "INFO")
        draw_wrapped(layout.box(), text, icon, line_width(context))
    return False


def line_width(context: bpy.types.Context) -> float:
    """How many pixels a line of the sidebar has for words."""
    return float(context.region.width - EDGES * context.preferences.system.ui_scale)
