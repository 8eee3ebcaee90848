"""3D views that show a mesh's colors in place of its materials, and how they were before.

What is shown is said by a mark on the mesh, which undo takes back; the shading of a view it does
not, so the views follow the mark.
"""

from __future__ import annotations

import json
from collections.abc import Iterator

import bpy
from bpy.app.handlers import persistent

MESH_BEFORE = "facestage_color_before"  # on the mesh: its active color attribute of before
VIEWS_BEFORE = "facestage_views_before"  # on the screen: the shading of its views, by area
SHOWING = {"type": "SOLID", "color_type": "VERTEX"}


def register() -> None:
    """Look after the views whenever something is undone."""
    bpy.app.handlers.undo_post.append(_after)
    bpy.app.handlers.redo_post.append(_after)


def unregister() -> None:
    """Undo :func:`register`."""
    bpy.app.handlers.redo_post.remove(_after)
    bpy.app.handlers.undo_post.remove(_after)


def is_shown(mesh: bpy.types.Mesh) -> bool:
    """Whether the views are to show its colors."""
    return MESH_BEFORE in mesh


def show_colors(mesh: bpy.types.Mesh, name: str) -> None:
    """Let all 3D views show the mesh's color attribute ``name``."""
    mesh[MESH_BEFORE] = mesh.attributes.active_color_name
    mesh.attributes.active_color_name = name
    mesh.update_tag()
    follow_marks()


def hide_colors(mesh: bpy.types.Mesh, name: str) -> None:
    """Give the mesh its active color attribute of before, and the views their shading, except for
    what was changed by hand since. Nothing happens where ``name`` is not shown.
    """
    before = mesh.get(MESH_BEFORE)
    if before is None:
        return
    del mesh[MESH_BEFORE]
    if mesh.attributes.active_color_name == name:
        mesh.attributes.active_color_name = before if before in mesh.attributes else ""
        mesh.update_tag()
    follow_marks()


def follow_marks() -> None:
    """Let the views show colors if a mesh says so, else what they showed before."""
    own = [mesh for mesh in bpy.data.meshes if mesh.users and mesh.library is None]
    if any(MESH_BEFORE in mesh for mesh in own):
        for window in bpy.context.window_manager.windows:
            if VIEWS_BEFORE not in window.screen:
                _show(window.screen)
        return
    for screen in bpy.data.screens:
        if VIEWS_BEFORE in screen:
            _give_back(screen)


def _show(screen: bpy.types.Screen) -> None:
    before = {
        place: {name: getattr(shading, name) for name in SHOWING}
        for place, shading in _shadings(screen)
    }
    screen[VIEWS_BEFORE] = json.dumps(before)
    for _, shading in _shadings(screen):
        for name, value in SHOWING.items():
            setattr(shading, name, value)


def _give_back(screen: bpy.types.Screen) -> None:
    before = json.loads(screen[VIEWS_BEFORE])
    del screen[VIEWS_BEFORE]
    for place, shading in _shadings(screen):
        for name, value in before.get(place, {}).items():
            if getattr(shading, name) == SHOWING[name]:
                setattr(shading, name, value)


def _shadings(screen: bpy.types.Screen) -> Iterator[tuple[str, bpy.types.View3DShading]]:
    """The screen's 3D views, by the numbers of their areas."""
    for place, area in enumerate(screen.areas):
        if area.type == "VIEW_3D":
            yield str(place), area.spaces.active.shading


@persistent
def _after(*_: object) -> None:
    follow_marks()
