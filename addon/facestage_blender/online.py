"""Whether Blender's user allows what it starts to go online."""

import bpy


def online_access() -> bool:
    """Blender's preference (System > Network > Allow Online Access), or its --online-mode and
    --offline-mode.

    Blender as a Python module has no preferences to set: there the user's own command line decides,
    as for `facestage`.
    """
    return bool(bpy.app.module or bpy.app.online_access)
