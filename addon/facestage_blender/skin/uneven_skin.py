"""Skin that sends more light at a slant and where it bulges (contract/scattering.py), without a
random walk.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from facestage.contract.curvature import Curvature
from facestage.contract.scattering import BULGE_M, MEAN_COSINE, SLANT

CURVATURE = "facestage_curvature"  # 1 / m, of the mesh's vertices; nothing where it is missing


def emerging(group: bpy.types.NodeTree, strength: Any, normal: Any, white: Any) -> Any:
    """Nodes that make of ``white`` (a socket: K_DIFFUSE * albedo) what is seen of it from where the
    ray comes from; the socket ``strength``: 0 as much everywhere, 1 as a random walk has it.
    """
    links = group.links

    def node(kind: str, x: float, y: float) -> Any:
        made = group.nodes.new(kind)
        made.location = (x, y)
        return made

    def vector(operation: str, x: float, *values: Any) -> Any:
        made = node("ShaderNodeVectorMath", x, 900)
        made.operation = operation
        for socket, value in zip(made.inputs, values, strict=False):
            if isinstance(value, bpy.types.NodeSocket):
                links.new(value, socket)
            else:
                socket.default_value = value
        return made

    geometry = node("ShaderNodeNewGeometry", -1800, 900)
    bends = node("ShaderNodeAttribute", -1800, 1200)
    bends.attribute_name = CURVATURE
    cosine = vector("DOT_PRODUCT", -1600, normal, geometry.outputs["Incoming"])
    slant = node("ShaderNodeMath", -1400, 900)
    slant.operation = "MULTIPLY_ADD"
    slant.inputs[1].default_value, slant.inputs[2].default_value = -SLANT, MEAN_COSINE * SLANT
    links.new(cosine.outputs["Value"], slant.inputs[0])
    bulge = vector("SCALE", -1600, BULGE_M)
    links.new(bends.outputs["Fac"], bulge.inputs["Scale"])
    both = vector("ADD", -1200, slant.outputs["Value"], bulge.outputs["Vector"])
    excess = vector("SCALE", -1000, both.outputs["Vector"])
    links.new(strength, excess.inputs["Scale"])
    left = vector("SUBTRACT", -1000, (1.0, 1.0, 1.0), white)
    factor = vector(
        "MULTIPLY_ADD", -800, excess.outputs["Vector"], left.outputs["Vector"], (1.0, 1.0, 1.0)
    )
    return vector("MULTIPLY", -600, white, factor.outputs["Vector"]).outputs["Vector"]


def set_curvature(rig: bpy.types.Object, vertices: np.ndarray | None) -> None:
    """Let the skin of a rig know where it bulges in the shape ``vertices`` (n, 3), m; None: where
    nothing asks.
    """
    mesh = rig.data
    attribute = mesh.attributes.get(CURVATURE)
    if vertices is None:
        if attribute is not None:
            mesh.attributes.remove(attribute)
        return
    mesh.calc_loop_triangles()
    triangles = np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    bends = Curvature(triangles.reshape(-1, 3), len(vertices)).of(vertices.astype(np.float64))
    attribute = attribute or mesh.attributes.new(CURVATURE, "FLOAT", "POINT")
    attribute.data.foreach_set("value", bends.astype(np.float32))
