"""Wrinkles that follow sliders, as a film has them: normal maps whose strengths are driven.

A normal map of strength s turns the smooth normal n to n_s; all of them together, and the normal
that the skin has without them, add up: n + sum (n_s - n_smooth), made unit again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy

from facestage.contract.texture_maps import NORMAL

from .material import WRINKLES, bent_socket, node_at, skin_nodes, smooth_normal, textures_uv_map

FRAME = "Wrinkles that follow sliders"


@dataclass(frozen=True, eq=False)
class DrivenWrinkles:
    """A normal map, whose strength is the mean of some sliders: ``paths`` from the shape ``keys``
    on.
    """

    name: str
    image: bpy.types.Image
    keys: bpy.types.Key
    paths: Sequence[str]


def give_wrinkles(rig: bpy.types.Object, wrinkles: Sequence[DrivenWrinkles]) -> None:
    """Let the skin of a rig have these, and no others."""
    take_wrinkles(rig, {each.image for each in wrinkles})
    if wrinkles:
        for tree in _skins(rig):
            _insert(tree, wrinkles)


def take_wrinkles(
    rig: bpy.types.Object, keep: frozenset[bpy.types.Image] | set[bpy.types.Image] = frozenset()
) -> None:
    """Take them out again, with their images, but for those to ``keep``."""
    for tree in _skins(rig):
        if WRINKLES in tree.nodes:
            _remove(tree, keep)


def strength_path(name: str) -> str:
    """Where a node tree has the strength of wrinkles."""
    return f'nodes["{bpy.utils.escape_identifier(_node_name(name))}"].inputs[0].default_value'


def _node_name(name: str) -> str:
    return f"{WRINKLES} {name}"


def _skins(rig: bpy.types.Object) -> list[bpy.types.NodeTree]:
    """The node trees of skin that takes normals."""
    return [tree for tree, node in skin_nodes(rig) if NORMAL.socket in node.inputs]


def _insert(tree: bpy.types.NodeTree, wrinkles: Sequence[DrivenWrinkles]) -> None:
    """Put the sum between the skin's normal and what it has been so far."""
    nodes, links = tree.nodes, tree.links
    uv_map, bent, smooth = textures_uv_map(nodes), bent_socket(nodes), smooth_normal(nodes)
    before = bent.links[0].from_socket if bent.is_linked else smooth
    frame = nodes.new("NodeFrame")
    frame.name = frame.label = FRAME

    def node(kind: str, column: int, row: int, operation: str = "") -> Any:
        made = node_at(nodes, kind, -1600 + 170 * column, 1900 - 60 * row)
        made.parent, made.hide = frame, True
        if operation:
            made.operation = operation
        return made

    first = node("ShaderNodeVectorMath", 3, 0, "ADD")
    first.name = WRINKLES
    first.inputs[1].default_value = (0.0, 0.0, 0.0)
    links.new(before, first.inputs[0])
    total = first.outputs[0]
    for row, each in enumerate(wrinkles, 1):
        picture, normal = node("ShaderNodeTexImage", 0, row), node("ShaderNodeNormalMap", 1, row)
        picture.image, picture.interpolation, picture.extension = each.image, "Linear", "EXTEND"
        if uv_map:
            uvs = node("ShaderNodeUVMap", -1, row)
            uvs.uv_map = uv_map
            links.new(uvs.outputs["UV"], picture.inputs["Vector"])
        normal.name, normal.uv_map = _node_name(each.name), uv_map
        links.new(picture.outputs["Color"], normal.inputs["Color"])
        change, sum_of = (
            node("ShaderNodeVectorMath", 2, row, "SUBTRACT"),
            node("ShaderNodeVectorMath", 3, row, "ADD"),
        )
        links.new(normal.outputs["Normal"], change.inputs[0])
        links.new(smooth, change.inputs[1])
        links.new(total, sum_of.inputs[0])
        links.new(change.outputs[0], sum_of.inputs[1])
        total = sum_of.outputs[0]
        _drive(tree, each)
    unit = node("ShaderNodeVectorMath", 4, 0, "NORMALIZE")
    links.new(total, unit.inputs[0])
    links.new(unit.outputs[0], bent)


def _drive(tree: bpy.types.NodeTree, wrinkles: DrivenWrinkles) -> None:
    """Of Blender's own kind, which needs no script."""
    driver = tree.driver_add(strength_path(wrinkles.name)).driver
    driver.type = "AVERAGE"
    for path in wrinkles.paths:
        variable = driver.variables.new()
        target = variable.targets[0]
        target.id_type, target.id = "KEY", wrinkles.keys
        target.data_path = path


def _remove(tree: bpy.types.NodeTree, keep: frozenset[Any] | set[Any]) -> None:
    nodes, links, bent = tree.nodes, tree.links, bent_socket(tree.nodes)
    before = nodes[WRINKLES].inputs[0]
    before = before.links[0].from_socket if before.is_linked else None
    if before is not None and before.node.type == "NEW_GEOMETRY":
        before = None
    frame = nodes[FRAME]
    data = tree.animation_data
    for curve in [] if data is None else list(data.drivers):
        if curve.data_path.startswith(f'nodes["{WRINKLES} '):
            data.drivers.remove(curve)
    images = set()
    for each in [node for node in nodes if node.parent == frame]:
        if each.type == "TEX_IMAGE" and each.image is not None:
            images.add(each.image)
        nodes.remove(each)
    nodes.remove(frame)
    for link in list(bent.links):
        links.remove(link)
    if before is not None:
        links.new(before, bent)
    for image in images - set(keep):
        if not image.users:
            bpy.data.images.remove(image)
