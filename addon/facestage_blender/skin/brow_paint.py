"""Less paint below brow hair, which on painted brows would make them twice as dark: the skin's
material shows more of the skin about them. Textures and exported files stay as they are.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .albedo_nodes import put_before_skin, take_out
from .material import node_at, skin_nodes

NODE = "Skin below Brows"
COLOR, SHARE = "facestage_brow_skin", "facestage_brow_share"  # attributes of the rig's vertices


def thin_paint(rig: bpy.types.Object, color: np.ndarray, share: np.ndarray) -> None:
    """Let the skin of a rig show ``color`` (vertices, 3), linear RGB, in place of a ``share``
    (vertices,), 0..1, of its albedo.
    """
    attributes = rig.data.attributes
    for name, kind, values in ((COLOR, "FLOAT_VECTOR", color), (SHARE, "FLOAT", share)):
        attribute = attributes.get(name) or attributes.new(name, kind, "POINT")
        field = "vector" if kind == "FLOAT_VECTOR" else "value"
        attribute.data.foreach_set(field, np.asarray(values, np.float32).ravel())
    for tree, _ in skin_nodes(rig):
        if NODE not in tree.nodes:
            _insert(tree)


def restore_paint(rig: bpy.types.Object) -> None:
    """Let the skin show its albedo alone again."""
    for tree, _ in skin_nodes(rig):
        mix = tree.nodes.get(NODE)
        if mix is None:
            continue
        take_out(tree, _socket(mix.inputs, "A"), _socket(mix.outputs, "Result"))
        for link in [*_socket(mix.inputs, "B").links, *mix.inputs["Factor"].links]:
            tree.nodes.remove(link.from_node)
        tree.nodes.remove(mix)
    for name in (COLOR, SHARE):
        if name in rig.data.attributes:
            rig.data.attributes.remove(rig.data.attributes[name])


def _insert(tree: bpy.types.NodeTree) -> None:
    """Mix what the skin's albedo is so far with the attributes."""
    mix = node_at(tree.nodes, "ShaderNodeMix", -250, 100)
    mix.name, mix.label, mix.data_type = NODE, NODE, "RGBA"
    put_before_skin(tree, _socket(mix.inputs, "A"), _socket(mix.outputs, "Result"))
    for name, output, target in (
        (COLOR, "Vector", _socket(mix.inputs, "B")),
        (SHARE, "Fac", mix.inputs["Factor"]),
    ):
        attribute = node_at(tree.nodes, "ShaderNodeAttribute", -450, 0)
        attribute.attribute_name = name
        tree.links.new(attribute.outputs[output], target)


def _socket(sockets: Any, name: str) -> bpy.types.NodeSocket:
    """A mix node's socket of colors."""
    return next(each for each in sockets if each.name == name and each.type == "RGBA")
