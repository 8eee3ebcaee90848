"""The preferences' buttons that install the backend and remove it."""

from pathlib import Path

import bpy

from facestage.contract.errors import BackendUnavailableError

from ..backend.environment import install_command, remove_environment
from ..drawing import draw_wrapped
from ..preferences import (
    DISK,
    DOWNLOAD,
    INSTALLING,
    addon_preferences,
    backend_command,
    environment_folder,
    online_access,
    packages,
)
from ..scene.paths import absolute
from .action import Action
from .backend_task import BackendTask
from .sidebar import SidebarPanel, draw_task, line_width


class FACESTAGE_OT_install_backend(BackendTask, bpy.types.Operator):
    """Makes the backend's environment."""

    bl_idname = "facestage.install_backend"
    bl_label = "Install Backend"
    bl_description = (
        f"Install the backend for Blender alone: {DOWNLOAD} of packages from PyPI, each checked "
        f"against the digest that the extension carries, {DISK} on disk. What a broken "
        "installation left is made anew"
    )

    task = INSTALLING

    def command(self, context: bpy.types.Context) -> list[str]:
        """Run the installer with Blender's own Python."""
        folder = self._wheels(context)
        if folder is None and not online_access():
            raise BackendUnavailableError(
                "Installing needs the network, and online access is off: allow it (System > "
                "Network > Allow Online Access), or choose a folder of wheels."
            )
        return install_command(environment_folder(), packages(), folder)

    @staticmethod
    def _wheels(context: bpy.types.Context) -> Path | None:
        preferences = addon_preferences(context)
        given = preferences.wheels if preferences else ""
        return absolute(given) if given else None


class FACESTAGE_OT_remove_backend(Action, bpy.types.Operator):
    """Remove the backend that Install Backend made; results and face models stay"""

    bl_idname = "facestage.remove_backend"
    bl_label = "Remove Backend"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Not while it runs."""
        return not context.window_manager.facestage.task

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """Ask first."""
        return context.window_manager.invoke_confirm(self, event)

    def act(self, context: bpy.types.Context) -> None:
        """Remove its environment."""
        remove_environment(environment_folder())
        self.report({"INFO"}, "The backend was removed.")


class FACESTAGE_PT_backend(SidebarPanel, bpy.types.Panel):
    """What is needed before the first step, while it is."""

    bl_label = "Backend"

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        """Only without a backend."""
        try:
            backend_command(context)
        except BackendUnavailableError:
            return True
        return False

    def draw(self, context: bpy.types.Context) -> None:
        """Offer to install it."""
        layout = self.layout
        sentence = (
            f"The fit runs in a program of its own: {DOWNLOAD} to download, {DISK} on disk. A "
            "folder of wheels, or another command, is set in the preferences."
        )
        draw_wrapped(layout, sentence, "INFO", line_width(context))
        if not draw_task(layout, context, INSTALLING):
            layout.operator("facestage.install_backend", icon="IMPORT")


CLASSES = (FACESTAGE_OT_install_backend, FACESTAGE_OT_remove_backend, FACESTAGE_PT_backend)
