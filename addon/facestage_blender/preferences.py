"""Where the backend is, whether it works, and whether it may go online."""

import blf
import bpy
from bpy.props import StringProperty

from facestage.contract.errors import BackendUnavailableError

from .backend.commands import find_backend

REPORT_LINES = 14
FONT = 0  # the interface's own
EDGES = 150.0  # pixels of the preferences, at a scale of 1, beside what a box in them says
OFFLINE = (
    "Online access is off (System > Network), so the backend downloads nothing: to find faces it "
    "needs the landmark model on this machine, and Check Backend says where."
)


class FacestagePreferences(bpy.types.AddonPreferences):
    """The add-on's preferences."""

    bl_idname = __package__

    backend: StringProperty(
        name="Backend",
        description="Command of the backend. Empty: $FACESTAGE_BACKEND, else facestage beside "
        "Python or on PATH",
        subtype="FILE_PATH",
    )
    report: StringProperty(
        name="Report", description="What the last check of the backend said", options={"SKIP_SAVE"}
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Show the backend's path, the check, and what it said."""
        layout = self.layout
        width = context.region.width - EDGES * context.preferences.system.ui_scale
        layout.prop(self, "backend")
        try:
            found = " ".join(find_backend(self.backend))
            layout.label(text=f"Using: {found}", icon="CHECKMARK")
        except BackendUnavailableError as error:
            draw_wrapped(layout, str(error), "ERROR", width)
        if not online_access():
            draw_wrapped(layout, OFFLINE, "INFO", width)
        running = context.window_manager.facestage.task
        layout.operator(
            "facestage.check_backend",
            icon="VIEWZOOM",
            text="Checking ..." if running else "Check Backend",
        )
        if self.report:
            box = layout.box().column(align=True)
            for line in self.report.splitlines()[-REPORT_LINES:]:
                box.label(text=line)


def backend_command(context: bpy.types.Context) -> list[str]:
    """The backend's command as the user set it or as it is found.

    Raises BackendUnavailableError.
    """
    preferences = addon_preferences(context)
    return find_backend(preferences.backend if preferences else "")


def addon_preferences(context: bpy.types.Context) -> FacestagePreferences | None:
    """The add-on's preferences, or None when a script registered it without enabling it."""
    addon = context.preferences.addons.get(__package__)
    return addon.preferences if addon else None


def draw_wrapped(layout: bpy.types.UILayout, text: str, icon: str, width: float) -> None:
    """Draw a sentence over several lines, each of at most ``width`` pixels: Blender's labels do not
    wrap, and end in dots where they are too long.
    """
    column = layout.column(align=True)
    for index, line in enumerate(wrapped(text, width)):
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


CLASSES = (FacestagePreferences,)


def online_access() -> bool:
    """Blender's preference (System > Network > Allow Online Access), or its --online-mode and
    --offline-mode.

    Blender as a Python module has no preferences to set: there the user's own command line decides,
    as for `facestage`. Older Blenders, 4.3 among them, do not say whether they are a module.
    """
    return bool(getattr(bpy.app, "module", False) or bpy.app.online_access)
