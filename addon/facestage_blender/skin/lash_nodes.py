"""Geometry nodes that let lashes follow the lids of a rig, whatever its shape keys do."""

from __future__ import annotations

from typing import Any

import bpy

GROUP = "Facestage Lashes"
# Of each vertex of the lashes: the rig's vertices that carry its root, with their weights, ...
ROOT, WEIGHTS = ("root_0", "root_1", "root_2"), "root_weights"
# ... two opposite ones of the eyeball, and the inner and outer corner of the eye, ...
BALL, CORNERS = ("ball_0", "ball_1"), ("corner_0", "corner_1")
# ... and where it is from its root: along the eye, away from the eyeball, and across both.
OFFSET = "offset"
INDICES = (*ROOT, *BALL, *CORNERS)


def lash_group(rig: bpy.types.Object) -> bpy.types.NodeTree:
    """New nodes that put each vertex at its offset from where ``rig`` has its root, turned with
    the lid about the eyeball.
    """
    group = bpy.data.node_groups.new(GROUP, "GeometryNodeTree")
    for way in ("INPUT", "OUTPUT"):
        group.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
    given, result = group.nodes.new("NodeGroupInput"), group.nodes.new("NodeGroupOutput")
    info = group.nodes.new("GeometryNodeObjectInfo")
    info.transform_space = "RELATIVE"
    info.inputs["Object"].default_value = rig
    build = _Builder(group, info.outputs["Geometry"])

    points = {name: build.point_of(name) for name in INDICES}
    weights = build.split(build.named(WEIGHTS, "FLOAT_VECTOR"))
    root = build.sum([build.scaled(points[n], w) for n, w in zip(ROOT, weights, strict=True)])
    middle = build.scaled(build.sum([points[name] for name in BALL]), 0.5)
    away = build.math("NORMALIZE", build.math("SUBTRACT", root, middle))
    line = build.math("SUBTRACT", points[CORNERS[1]], points[CORNERS[0]])
    across = build.math("NORMALIZE", build.math("CROSS_PRODUCT", away, line))
    along = build.math("CROSS_PRODUCT", across, away)
    offset = build.split(build.named(OFFSET, "FLOAT_VECTOR"))
    moved = [build.scaled(axis, s) for axis, s in zip((along, away, across), offset, strict=True)]

    place = group.nodes.new("GeometryNodeSetPosition")
    group.links.new(given.outputs["Geometry"], place.inputs["Geometry"])
    group.links.new(build.sum([root, *moved]), place.inputs["Position"])
    group.links.new(place.outputs["Geometry"], result.inputs["Geometry"])
    return group


class _Builder:
    """Makes nodes of vectors; sockets in, sockets out."""

    def __init__(self, group: bpy.types.NodeTree, geometry: Any) -> None:
        self.group, self.geometry = group, geometry
        self.position = group.nodes.new("GeometryNodeInputPosition").outputs[0]

    def named(self, name: str, kind: str) -> Any:
        """An attribute of the lashes' vertices."""
        node = self.group.nodes.new("GeometryNodeInputNamedAttribute")
        node.data_type = kind
        node.inputs["Name"].default_value = name
        return next(each for each in node.outputs if each.enabled and each.name == "Attribute")

    def point_of(self, name: str) -> Any:
        """The place of the rig's vertex that an attribute names."""
        node = self.group.nodes.new("GeometryNodeSampleIndex")
        node.data_type, node.domain = "FLOAT_VECTOR", "POINT"
        self.group.links.new(self.geometry, node.inputs["Geometry"])
        value = next(each for each in node.inputs if each.enabled and each.name == "Value")
        self.group.links.new(self.position, value)
        self.group.links.new(self.named(name, "INT"), node.inputs["Index"])
        return next(each for each in node.outputs if each.enabled and each.name == "Value")

    def math(self, operation: str, a: Any, b: Any = None) -> Any:
        """A vector operation."""
        node = self.group.nodes.new("ShaderNodeVectorMath")
        node.operation = operation
        self.group.links.new(a, node.inputs[0])
        if b is not None:
            self.group.links.new(b, node.inputs[1])
        return node.outputs["Vector"]

    def scaled(self, vector: Any, factor: Any) -> Any:
        """A vector times a number, or a socket of one."""
        node = self.group.nodes.new("ShaderNodeVectorMath")
        node.operation = "SCALE"
        self.group.links.new(vector, node.inputs[0])
        if isinstance(factor, float):
            node.inputs["Scale"].default_value = factor
        else:
            self.group.links.new(factor, node.inputs["Scale"])
        return node.outputs["Vector"]

    def sum(self, vectors: list[Any]) -> Any:
        """Their sum."""
        total = vectors[0]
        for each in vectors[1:]:
            total = self.math("ADD", total, each)
        return total

    def split(self, vector: Any) -> tuple[Any, Any, Any]:
        """Its three numbers."""
        node = self.group.nodes.new("ShaderNodeSeparateXYZ")
        self.group.links.new(vector, node.inputs[0])
        return node.outputs[0], node.outputs[1], node.outputs[2]
