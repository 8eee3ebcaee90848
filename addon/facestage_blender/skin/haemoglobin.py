"""Blood that comes and goes in the skin, as a film has it: functions on the rig's vertices, each
times a number that may be keyed.

Of the albedo's logarithm haemoglobin changes so much of each channel, so the material multiplies
the albedo by a color to the power of what the functions add up to.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from facestage.contract.arrays import Float

from .albedo_nodes import put_before_skin, take_out
from .material import node_at, skin_nodes

HAEMOGLOBIN = "Haemoglobin"  # the frame of its nodes
ATTRIBUTE = "facestage_haemoglobin"  # each holds three functions
WEIGHTS = "Haemoglobin Weights"
FACTOR = "Albedo with Haemoglobin"


def give_haemoglobin(
    rig: bpy.types.Object,
    harmonics: Float[np.ndarray, "harmonics vertices"],
    color: Float[np.ndarray, " 3"],
) -> list[bpy.types.NodeTree]:
    """Let the skin of a rig have more or less of it; ``color``: what one adds to log albedo, linear
    RGB. Returns the node trees whose :func:`weight_path` may be keyed.
    """
    take_haemoglobin(rig)
    count = -(-len(harmonics) // 3)
    table = np.zeros((3 * count, harmonics.shape[1]), np.float32)
    table[: len(harmonics)] = harmonics
    for number, three in enumerate(table.reshape(count, 3, -1)):
        attribute = rig.data.attributes.new(_attribute(number), "FLOAT_VECTOR", "POINT")
        attribute.data.foreach_set("vector", np.ascontiguousarray(three.T).ravel())
    trees = [tree for tree, _ in skin_nodes(rig)]
    for tree in trees:
        _insert(tree, count, color)
    return trees


def take_haemoglobin(rig: bpy.types.Object) -> list[bpy.types.NodeTree]:
    """Take it out again; returns the node trees that had it."""
    trees = [tree for tree, _ in skin_nodes(rig) if HAEMOGLOBIN in tree.nodes]
    for tree in trees:
        _remove(tree)
    attributes = rig.data.attributes
    for name in [name for name in attributes.keys() if name.startswith(ATTRIBUTE)]:  # noqa: SIM118
        attributes.remove(attributes[name])
    return trees


def weight_path(harmonic: int) -> tuple[str, int]:
    """Where a node tree has the weight of a function: path and index."""
    name = bpy.utils.escape_identifier(f"{WEIGHTS} {harmonic // 3}")
    return f'nodes["{name}"].inputs[1].default_value', harmonic % 3


def _attribute(number: int) -> str:
    return f"{ATTRIBUTE}_{number}"


def _insert(tree: bpy.types.NodeTree, count: int, color: Float[np.ndarray, " 3"]) -> None:
    """Put a factor between the skin's albedo and what it has been so far."""
    nodes, links = tree.nodes, tree.links
    frame = nodes.new("NodeFrame")
    frame.name = frame.label = HAEMOGLOBIN

    def node(kind: str, column: int, row: int) -> Any:
        made = node_at(nodes, kind, -1200 + 170 * column, 1300 - 60 * row)
        made.parent, made.hide = frame, True
        return made

    total = None
    for number in range(count):
        functions, weighed = (
            node("ShaderNodeAttribute", 0, number),
            node("ShaderNodeVectorMath", 1, number),
        )
        functions.attribute_name = _attribute(number)
        weighed.operation, weighed.name = "DOT_PRODUCT", f"{WEIGHTS} {number}"
        weighed.inputs[1].default_value = (0.0, 0.0, 0.0)
        links.new(functions.outputs["Vector"], weighed.inputs[0])
        value = weighed.outputs["Value"]
        if total is not None:
            added = node("ShaderNodeMath", 2, number)
            links.new(total, added.inputs[0])
            links.new(value, added.inputs[1])
            value = added.outputs[0]
        total = value
    factor = node("ShaderNodeCombineXYZ", 4, 0)
    for channel, change in enumerate(np.exp(color)):
        power = node("ShaderNodeMath", 3, channel)
        power.operation = "POWER"
        power.inputs[0].default_value = float(change)
        links.new(total, power.inputs[1])
        links.new(power.outputs[0], factor.inputs[channel])
    product = node("ShaderNodeVectorMath", 5, 0)
    product.operation, product.name = "MULTIPLY", FACTOR
    links.new(factor.outputs[0], product.inputs[1])
    put_before_skin(tree, product.inputs[0], product.outputs[0])


def _remove(tree: bpy.types.NodeTree) -> None:
    product = tree.nodes[FACTOR]
    take_out(tree, product.inputs[0], product.outputs[0])
    frame = tree.nodes[HAEMOGLOBIN]
    for each in [node for node in tree.nodes if node.parent == frame]:
        tree.nodes.remove(each)
    tree.nodes.remove(frame)
