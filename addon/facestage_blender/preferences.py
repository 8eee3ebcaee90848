"""Where the backend is, how it is installed, whether it works, and whether it may go online."""

from pathlib import Path

import bpy
from bpy.props import StringProperty

from facestage.contract.errors import BackendUnavailableError

from .backend.commands import find_backend
from .backend.environment import Packages, installed_command
from .drawing import draw_progress, draw_wrapped

REPORT_LINES = 14
INSTALLING, CHECKING = "Installing the backend", "Checking the backend"  # the tasks shown here
EDGES = 70.0  # pixels of the preferences, at a scale of 1, beside what a box in them says
# Measured for Python 3.11 and 3.13 on Linux; elsewhere about the same.
DOWNLOAD, DISK = "225 MB", "0.8 GB"
OFFLINE = (
    "Online access is off (System > Network), so the backend downloads nothing: to find faces it "
    "needs the landmark model on this machine, and Check Backend says where."
)


class FacestagePreferences(bpy.types.AddonPreferences):
    """The add-on's preferences."""

    bl_idname = __package__

    backend: StringProperty(
        name="Backend",
        description="Command of the backend. Empty: $FACESTAGE_BACKEND, else the one that Install "
        "Backend made, else facestage beside Python or on PATH",
        subtype="FILE_PATH",
    )
    wheels: StringProperty(
        name="From Folder",
        description="Folder of wheels to install the backend from, without a network. Empty: PyPI",
        subtype="DIR_PATH",
    )
    report: StringProperty(
        name="Report", description="What the last check of the backend said", options={"SKIP_SAVE"}
    )

    def draw(self, context: bpy.types.Context) -> None:
        """Show the backend's path, how to install it, the check, and what it said."""
        layout, state = self.layout, context.window_manager.facestage
        width = context.region.width - EDGES * context.preferences.system.ui_scale
        installed = installed_backend()
        try:
            found = find_backend(self.backend, installed)
            what = "the installed backend" if found == installed else " ".join(found)
            draw_wrapped(layout, f"Using {what}", "CHECKMARK", width)
        except BackendUnavailableError as error:
            draw_wrapped(layout, str(error), "ERROR", width)
        if state.task in {INSTALLING, CHECKING}:
            draw_progress(layout, state, width)
        else:
            self._draw_install(layout, bool(installed))
            if state.began in {INSTALLING, CHECKING} and (state.failure or state.notice):
                icon = "ERROR" if state.failure else "INFO"
                draw_wrapped(layout.box(), state.failure or state.notice, icon, width)
        layout.prop(self, "backend", text="Or Its Command")
        if not online_access():
            draw_wrapped(layout, OFFLINE, "INFO", width)
        layout.operator("facestage.check_backend", icon="VIEWZOOM")
        if self.report:
            box = layout.box().column(align=True)
            for line in self.report.splitlines()[-REPORT_LINES:]:
                box.label(text=line)

    def _draw_install(self, layout: bpy.types.UILayout, installed: bool) -> None:
        row = layout.row(align=True)
        source = "from the folder" if self.wheels else f"{DOWNLOAD} to download"
        row.operator(
            "facestage.install_backend",
            icon="FILE_REFRESH" if installed else "IMPORT",
            text="Install Again" if installed else f"Install Backend ({source}, {DISK} on disk)",
        )
        if environment_folder().exists():
            row.operator("facestage.remove_backend", icon="TRASH", text="Remove")
        layout.prop(self, "wheels")


def backend_command(context: bpy.types.Context) -> list[str]:
    """The backend's command as the user set it, as it was installed or as it is found.

    Raises BackendUnavailableError.
    """
    preferences = addon_preferences(context)
    return find_backend(preferences.backend if preferences else "", installed_backend())


def installed_backend() -> list[str]:
    """The command of the backend that Install Backend made; empty where there is none."""
    try:
        return installed_command(environment_folder(), packages())
    except BackendUnavailableError:
        return []


def packages() -> Packages:
    """What comes with this extension to install. Raises BackendUnavailableError."""
    return Packages.of_extension(Path(__file__).parent)


def environment_folder() -> Path:
    """Where the backend is installed."""
    return _user_folder("environment")


def expression_folder() -> Path:
    """Where the user's own expressions are kept."""
    return _user_folder("expressions")


def _user_folder(name: str) -> Path:
    """A folder in the extension's own folder of user files."""
    try:
        folder = bpy.utils.extension_path_user(str(__package__), path=name)
    except ValueError:  # the add-on is no extension
        folder = bpy.utils.user_resource("DATAFILES", path=f"facestage/{name}")
    return Path(folder)


def addon_preferences(context: bpy.types.Context) -> FacestagePreferences | None:
    """The add-on's preferences, or None when a script registered it without enabling it."""
    addon = context.preferences.addons.get(__package__)
    return addon.preferences if addon else None


CLASSES = (FacestagePreferences,)


def online_access() -> bool:
    """Blender's preference (System > Network > Allow Online Access), or its --online-mode and
    --offline-mode.

    Blender as a Python module has no preferences to set: there the user's own command line decides,
    as for `facestage`. Older Blenders, 4.3 among them, do not say whether they are a module.
    """
    return bool(getattr(bpy.app, "module", False) or bpy.app.online_access)
