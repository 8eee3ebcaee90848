"""Folds that the photo's expression painted into the albedo: they fade as its sliders go back.

The material divides the albedo by what the folds make of it, to the power of how far they are gone,
which a driver says for each place by the sliders that pull at it (contract/folds.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np

from facestage.contract.folds import PLACES, ROUNDING, Folds
from facestage.contract.texture_maps import FOLD_MAP

from .albedo_nodes import put_before_skin, take_out
from .material import node_at, skin_nodes, textures_uv_map

FOLDS = "Folds of the Expression"  # the frame of its nodes
ATTRIBUTE = "facestage_folds"
GONE = "Folds That Are Gone"
FACTOR = "Albedo without Folds"
PRECISION = 4  # decimals of a driver's numbers


def give_folds(
    rig: bpy.types.Object,
    image: bpy.types.Image | None,
    folds: Folds | None,
    paths: Sequence[str | None],
) -> None:
    """Let the folds in the ``image`` go with the sliders at ``paths`` from the shape keys on, one
    for each expression. Folds of a place where one is missing that pulls stay as they are. None:
    there are none, or no longer.
    """
    take_folds(rig)
    if image is None or folds is None or len(folds.place) != len(rig.data.vertices):
        return
    pulls = [
        {path: float(value) for path, value in zip(paths, row, strict=True) if value != 0}
        for row in folds.pull
    ]
    driven = [bool(pull) and None not in pull for pull in pulls]
    attribute = rig.data.attributes.new(ATTRIBUTE, "FLOAT_VECTOR", "POINT")
    place = np.ascontiguousarray(folds.place * driven, np.float32)
    attribute.data.foreach_set("vector", place.ravel())
    for tree, _ in skin_nodes(rig):
        _insert(tree, image)
        for index in np.flatnonzero(driven):
            _drive(tree, int(index), rig.data.shape_keys, pulls[index])


def take_folds(rig: bpy.types.Object) -> None:
    """Leave the albedo as it is painted."""
    for tree, _ in skin_nodes(rig):
        if FOLDS in tree.nodes:
            _remove(tree)
    if ATTRIBUTE in rig.data.attributes:
        rig.data.attributes.remove(rig.data.attributes[ATTRIBUTE])


def gone_path() -> str:
    """Where a node tree has the shares of the folds that are gone, one for each of PLACES."""
    return f'nodes["{bpy.utils.escape_identifier(GONE)}"].inputs[1].default_value'


def _drive(
    tree: bpy.types.NodeTree, index: int, keys: bpy.types.Key, pull: dict[str | None, float]
) -> None:
    """By an expression simple enough for Blender to need no script."""
    driver = tree.driver_add(gone_path(), index).driver
    driver.type = "SCRIPTED"
    terms = []
    for number, (path, value) in enumerate(pull.items()):
        variable = driver.variables.new()
        variable.name = f"v{number}"
        target = variable.targets[0]
        target.id_type, target.id = "KEY", keys
        target.data_path = path
        terms.append(f"({value:.{PRECISION}f})*v{number}")
    # What so few decimals leave of the photo's own expression is rounding.
    whole = 1 - ROUNDING - 10**-PRECISION
    driver.expression = f"max(0,min(1,{whole:.5f}-({'+'.join(terms)})))"


def _insert(tree: bpy.types.NodeTree, image: bpy.types.Image) -> None:
    nodes, links = tree.nodes, tree.links
    uv_map = textures_uv_map(nodes)
    frame = nodes.new("NodeFrame")
    frame.name = frame.label = FOLDS

    def node(kind: str, column: int, row: int, operation: str = "") -> Any:
        made = node_at(nodes, kind, -1200 + 170 * column, 2600 - 60 * row)
        made.parent, made.hide = frame, True
        if operation:
            made.operation = operation
        return made

    picture = node("ShaderNodeTexImage", 0, 0)
    picture.image, picture.interpolation, picture.extension = image, "Linear", "EXTEND"
    picture.name = picture.label = FOLD_MAP.socket
    if uv_map:
        uvs = node("ShaderNodeUVMap", -1, 0)
        uvs.uv_map = uv_map
        links.new(uvs.outputs["UV"], picture.inputs["Vector"])
    place = node("ShaderNodeAttribute", 0, 1)
    place.attribute_name = ATTRIBUTE
    gone = node("ShaderNodeVectorMath", 1, 1, "DOT_PRODUCT")
    gone.name = gone.label = GONE
    gone.inputs[1].default_value = (0.0,) * len(PLACES)
    links.new(place.outputs["Vector"], gone.inputs[0])
    back = node("ShaderNodeMath", 2, 1, "MULTIPLY")
    back.inputs[1].default_value = -1.0
    links.new(gone.outputs["Value"], back.inputs[0])
    channels, factor = node("ShaderNodeSeparateXYZ", 1, 0), node("ShaderNodeCombineXYZ", 4, 0)
    links.new(picture.outputs["Color"], channels.inputs[0])
    for channel in range(3):
        power = node("ShaderNodeMath", 3, channel, "POWER")
        links.new(channels.outputs[channel], power.inputs[0])
        links.new(back.outputs[0], power.inputs[1])
        links.new(power.outputs[0], factor.inputs[channel])
    product = node("ShaderNodeVectorMath", 5, 0, "MULTIPLY")
    product.name = product.label = FACTOR
    links.new(factor.outputs[0], product.inputs[1])
    put_before_skin(tree, product.inputs[0], product.outputs[0])


def _remove(tree: bpy.types.NodeTree) -> None:
    for index in range(len(PLACES)):
        tree.driver_remove(gone_path(), index)
    product = tree.nodes[FACTOR]
    take_out(tree, product.inputs[0], product.outputs[0])
    frame = tree.nodes[FOLDS]
    for each in [node for node in tree.nodes if node.parent == frame]:
        tree.nodes.remove(each)
    tree.nodes.remove(frame)
