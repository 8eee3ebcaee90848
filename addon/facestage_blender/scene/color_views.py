"""3D views that show a mesh's colors in place of its materials, or its textures in place of grey,
and how they were before.

What is shown is said by marks on the mesh, which undo takes back; the shading of a view it does
not, so the views follow the marks.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass

import bpy
from bpy.app.handlers import persistent

MESH_BEFORE = "facestage_color_before"  # on the mesh: its active color attribute of before
SKIN = "facestage_skin"  # on the mesh: whether its textures are to be shown


@dataclass(frozen=True)
class _Showing:
    """How views show something, where they were ``over`` something."""

    before: str  # on the screen: the shading of its views before, by area
    shading: Mapping[str, str]
    over: Mapping[str, str]
    solid: bool = False  # whether these are other values in views that are not Solid


COLORS = _Showing("facestage_views_before", {"type": "SOLID", "color_type": "VERTEX"}, {})
# Lie below the other. Whoever shows objects' colors in Solid has chosen to. Blender's usual light
# there is for clay: light skin looks dark in it.
TEXTURES = _Showing("facestage_skin_before", {"color_type": "TEXTURE"}, {"color_type": "MATERIAL"})
LIGHT = _Showing(
    "facestage_light_before",
    {"studio_light": "paint.sl"},
    {"color_type": "TEXTURE", "light": "STUDIO", "studio_light": "Default"},
    solid=True,
)


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


def shows_skin(mesh: bpy.types.Mesh) -> bool:
    """Whether Solid views are to show its textures."""
    return bool(mesh.get(SKIN))


def show_skin(mesh: bpy.types.Mesh, on: bool) -> None:
    """Let Solid views show the mesh's textures, or its grey material as before."""
    mesh[SKIN] = on
    follow_marks()


def show_new_skin(mesh: bpy.types.Mesh) -> None:
    """The same for textures that are new, unless it was turned off by hand."""
    if SKIN not in mesh:
        show_skin(mesh, True)


def take_marks_off(mesh: bpy.types.Mesh, name: str) -> None:
    """Leave a copy of a mesh as if neither its textures nor its color attribute ``name`` were
    shown; the views stay as they are.
    """
    mesh.pop(SKIN, None)
    before = mesh.pop(MESH_BEFORE, None)
    if mesh.attributes.active_color_name == name and before in mesh.attributes:
        mesh.attributes.active_color_name = before


def follow_marks() -> None:
    """Let the views show what meshes say, else what they showed before."""
    own = [mesh for mesh in bpy.data.meshes if mesh.users and mesh.library is None]
    colors, textures = (any(told(mesh) for mesh in own) for told in (is_shown, shows_skin))
    for screen in bpy.data.screens:
        if COLORS.before in screen and not (colors and textures == (TEXTURES.before in screen)):
            _give_back(screen, COLORS)
        for showing in (LIGHT, TEXTURES):
            if showing.before in screen and not textures:
                _give_back(screen, showing)
    for screen in {window.screen for window in bpy.context.window_manager.windows}:
        for showing, wanted in ((TEXTURES, textures), (LIGHT, textures), (COLORS, colors)):
            if wanted and showing.before not in screen:
                _show(screen, showing)


def _show(screen: bpy.types.Screen, showing: _Showing) -> None:
    before = {}
    for place, shading in _shadings(screen, showing.solid):
        if any(getattr(shading, name) != value for name, value in showing.over.items()):
            continue
        before[place] = {name: getattr(shading, name) for name in showing.shading}
        for name, value in showing.shading.items():
            with suppress(TypeError):  # studio lights are files, which may not be there
                setattr(shading, name, value)
    screen[showing.before] = json.dumps(before)


def _give_back(screen: bpy.types.Screen, showing: _Showing) -> None:
    before = json.loads(screen[showing.before])
    del screen[showing.before]
    for place, shading in _shadings(screen, showing.solid):
        for name, value in before.get(place, {}).items():
            if getattr(shading, name) == showing.shading[name]:
                setattr(shading, name, value)


def _shadings(
    screen: bpy.types.Screen, solid: bool
) -> Iterator[tuple[str, bpy.types.View3DShading]]:
    """The screen's 3D views, by the numbers of their areas; each ``solid`` meanwhile, if wanted."""
    for place, area in enumerate(screen.areas):
        if area.type == "VIEW_3D":
            shading = area.spaces.active.shading
            before = shading.type
            if solid and before != "SOLID":
                shading.type = "SOLID"
            yield str(place), shading
            if solid and before != "SOLID":
                shading.type = before


@persistent
def _after(*_: object) -> None:
    follow_marks()
