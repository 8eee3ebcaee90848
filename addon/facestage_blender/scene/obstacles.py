"""What else in the scene would hide the face or light it: found, put out of the way, given back."""

from __future__ import annotations

from collections.abc import Iterator

import bpy
import numpy as np
from mathutils import Vector

from facestage.contract.errors import InputError

from .relight import lit_by_world
from .several import other_faces
from .softbox import softbox_of
from .stage import require_stage, stage_lights

SOLID = frozenset({"MESH", "CURVE", "CURVES", "SURFACE", "META", "FONT", "VOLUME", "POINTCLOUD"})
MARGIN = 1.05  # of the stage's radius
# On an object that was put out of the way: whether it was hidden in the viewport before.
HIDDEN = "facestage_hidden"


def obstacles(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """What is rendered among or between the stage's lights and is not Facestage's, and other lights
    that shine. What hangs on the face, or the face hangs on, is part of it.

    Raises InputError without a stage.
    """
    empty = require_stage(scene)
    own = {empty, softbox_of(empty), *stage_lights(empty), *_of_the_face(scene.facestage.rig)}
    for face in other_faces(scene):  # in their own light
        own |= {face.rig, *_of_the_face(face.rig)}
        own |= set() if face.stage is None else set(face.stage.children_recursive)
    center = empty.matrix_world.translation
    lights = stage_lights(empty)
    reach = MARGIN * max((_away(light, center) for light in lights), default=0.0)
    found = []
    for item in scene.view_layers[0].objects:
        if item in own or item.hide_render or item.get(HIDDEN) is not None:
            continue
        if item.type == "LIGHT":
            if item.data.energy > 0:
                found.append(item)
        elif item.type in SOLID and _reaches(item, center, reach):
            found.append(item)
    return found


def world_shines(scene: bpy.types.Scene) -> bool:
    """Whether the world lights the scene, other than Light From means it to."""
    world = scene.world
    if world is None or lit_by_world(scene):
        return False
    # From Blender 5.0 on a world always has nodes, and asking warns.
    plain = bpy.app.version < (5, 0, 0) and not world.use_nodes
    if world.node_tree is None or plain:
        return any(world.color)
    backgrounds = [node for node in world.node_tree.nodes if node.type == "BACKGROUND"]
    return any(
        strength.is_linked or (strength.default_value > 0 and (color.is_linked or any(_rgb(color))))
        for strength, color in (
            (node.inputs["Strength"], node.inputs["Color"]) for node in backgrounds
        )
    )


def clear(scene: bpy.types.Scene) -> list[str]:
    """Hide the obstacles and take the world's light away; the names of what that was.

    Raises InputError without a stage.
    """
    found = obstacles(scene)
    names = [item.name for item in found]
    for item in found:
        item[HIDDEN] = item.hide_viewport
        item.hide_render = item.hide_viewport = True
    if world_shines(scene):
        names.append(f"the world '{scene.world.name}'")
        scene.facestage.world_before, scene.world = scene.world, None
    return names


def cleared(scene: bpy.types.Scene) -> bool:
    """Whether something is out of the way that can be given back."""
    return scene.facestage.world_before is not None or any(
        item.get(HIDDEN) is not None for item in scene.objects
    )


def give_back(scene: bpy.types.Scene) -> None:
    """Undo :func:`clear`. Raises InputError when there is nothing to give back."""
    if not cleared(scene):
        raise InputError("Nothing of the scene is out of the way.")
    for item in scene.objects:
        if item.get(HIDDEN) is not None:
            item.hide_render, item.hide_viewport = False, bool(item[HIDDEN])
            del item[HIDDEN]
    if scene.facestage.world_before is not None:
        if scene.world is None:  # else the user has chosen another since
            scene.world = scene.facestage.world_before
        scene.facestage.world_before = None


def _of_the_face(rig: bpy.types.Object | None) -> Iterator[bpy.types.Object]:
    if rig is None:
        return
    yield rig
    yield from rig.children_recursive
    parent = rig.parent
    while parent is not None:
        yield parent
        yield from parent.children_recursive
        parent = parent.parent


def _away(item: bpy.types.Object, center: Vector) -> float:
    return float((item.matrix_world.translation - center).length)


def _reaches(item: bpy.types.Object, center: Vector, reach: float) -> bool:
    """Whether the box around an object comes nearer to ``center`` than ``reach``."""
    corners = np.array([item.matrix_world @ Vector(corner) for corner in item.bound_box])
    nearest = np.clip(center, corners.min(axis=0), corners.max(axis=0))
    return bool(np.linalg.norm(nearest - np.array(center)) < reach)


def _rgb(color: bpy.types.NodeSocket) -> list[float]:
    return list(color.default_value)[:3]
