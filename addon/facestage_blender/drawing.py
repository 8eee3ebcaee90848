"""What panels and preferences draw alike: sentences over several lines, a task's progress."""

import blf
import bpy

from .translations import said

FONT = 0  # the interface's own


def draw_wrapped(layout: bpy.types.UILayout, text: str, icon: str, width: float) -> None:
    """Draw a sentence over several lines, each of at most ``width`` pixels: Blender's labels do not
    wrap, and end in dots where they are too long.
    """
    column = layout.column(align=True)
    for index, line in enumerate(wrapped(said(text), width)):
        column.label(text=line, icon=icon if index == 0 else "BLANK1")


def wrapped(text: str, width: float) -> list[str]:
    """The lines that a sentence fills in the interface's font, each of at most ``width`` pixels or
    one word.
    """
    preferences = bpy.context.preferences
    # Blender as a module has no interface, hence no scale.
    blf.size(FONT, preferences.ui_styles[0].widget.points * (preferences.system.ui_scale or 1.0))
    lines = [""]
    for word in text.split():
        longer = f"{lines[-1]} {word}".strip()
        if lines[-1] and blf.dimensions(FONT, longer)[0] > width:
            lines.append(word)
        else:
            lines[-1] = longer
    return lines


def draw_progress(layout: bpy.types.UILayout, state: bpy.types.PropertyGroup, width: float) -> None:
    """The running task's bar, what it says of itself in ``width`` pixels, and Cancel."""
    text = f"{state.task}: {state.stage}" if state.stage else state.task
    if state.stage and len(wrapped(f"100%  {text}", width)) > 1:
        text = state.stage
    row = layout.row(align=True)
    if hasattr(row, "progress"):
        row.progress(text=f"{state.fraction:.0%}  {text}", factor=state.fraction, type="BAR")
    else:
        row.prop(state, "fraction", text=text, slider=True)
    row.operator("facestage.cancel", icon="CANCEL", text="")
    details = []
    if state.photo_error >= 0:
        details.append(said("photo error {error}", error=f"{state.photo_error:.4f}"))
    if state.seconds_left >= 0:
        details.append(said("about {seconds} s left", seconds=f"{state.seconds_left:.0f}"))
    if state.cancel:
        details = [said("Stopping ...")]
    if details:
        layout.label(text=", ".join(details), icon="TIME")
