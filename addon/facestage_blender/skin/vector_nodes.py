"""Makes nodes of vector arithmetic, in shaders and in geometry nodes; sockets in, sockets out."""

from __future__ import annotations

from typing import Any

import bpy

# Of each vertex that grows on a rig: the rig's vertices that carry its root, with their weights,
# two opposite ones of the eyeball, and where it is from its root, along axes of its own.
ROOT, WEIGHTS = ("root_0", "root_1", "root_2"), "root_weights"
BALL, OFFSET = ("ball_0", "ball_1"), "offset"


class VectorNodes:
    """Nodes of vectors in a tree of any kind."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree

    def math(self, operation: str, a: Any, b: Any = None) -> Any:
        """A vector operation; DOT_PRODUCT, LENGTH and DISTANCE give a number."""
        node = self.tree.nodes.new("ShaderNodeVectorMath")
        node.operation = operation
        self._give(node.inputs[0], a)
        if b is not None:
            self._give(node.inputs[1], b)
        number = operation in ("DOT_PRODUCT", "LENGTH", "DISTANCE")
        return node.outputs["Value" if number else "Vector"]

    def scaled(self, vector: Any, factor: Any) -> Any:
        """A vector times a number, or a socket of one."""
        node = self.tree.nodes.new("ShaderNodeVectorMath")
        node.operation = "SCALE"
        self._give(node.inputs[0], vector)
        self._give(node.inputs["Scale"], factor)
        return node.outputs["Vector"]

    def sum(self, vectors: list[Any]) -> Any:
        """Their sum."""
        total = vectors[0]
        for each in vectors[1:]:
            total = self.math("ADD", total, each)
        return total

    def split(self, vector: Any) -> tuple[Any, Any, Any]:
        """Its three numbers."""
        node = self.tree.nodes.new("ShaderNodeSeparateXYZ")
        self.tree.links.new(vector, node.inputs[0])
        return node.outputs[0], node.outputs[1], node.outputs[2]

    def joined(self, *numbers: Any) -> Any:
        """A vector of three numbers."""
        node = self.tree.nodes.new("ShaderNodeCombineXYZ")
        for socket, number in zip(node.inputs, numbers, strict=True):
            self._give(socket, number)
        return node.outputs[0]

    def number(self, operation: str, *values: Any) -> Any:
        """An operation on numbers."""
        node = self.tree.nodes.new("ShaderNodeMath")
        node.operation = operation
        for socket, value in zip(node.inputs, values, strict=False):
            self._give(socket, value)
        return node.outputs[0]

    def _give(self, socket: Any, value: Any) -> None:
        if isinstance(value, float | int | tuple):
            socket.default_value = value
        else:
            self.tree.links.new(value, socket)


class RiggedVectors(VectorNodes):
    """Geometry nodes that put the vertices of one object where another, the rig, has its own."""

    def __init__(self, name: str, rig: bpy.types.Object) -> None:
        tree = bpy.data.node_groups.new(name, "GeometryNodeTree")
        super().__init__(tree)
        for way in ("INPUT", "OUTPUT"):
            tree.interface.new_socket("Geometry", in_out=way, socket_type="NodeSocketGeometry")
        self.given = tree.nodes.new("NodeGroupInput").outputs["Geometry"]
        self.result = tree.nodes.new("NodeGroupOutput").inputs["Geometry"]
        info = tree.nodes.new("GeometryNodeObjectInfo")
        info.transform_space = "RELATIVE"
        info.inputs["Object"].default_value = rig
        self.geometry = info.outputs["Geometry"]
        self.position = tree.nodes.new("GeometryNodeInputPosition").outputs[0]

    def named(self, name: str, kind: str) -> Any:
        """An attribute of the vertices that are put."""
        node = self.tree.nodes.new("GeometryNodeInputNamedAttribute")
        node.data_type = kind
        node.inputs["Name"].default_value = name
        return next(each for each in node.outputs if each.enabled and each.name == "Attribute")

    def point_of(self, name: str) -> Any:
        """The place of the rig's vertex that an attribute names."""
        node = self.tree.nodes.new("GeometryNodeSampleIndex")
        node.data_type, node.domain = "FLOAT_VECTOR", "POINT"
        self.tree.links.new(self.geometry, node.inputs["Geometry"])
        value = next(each for each in node.inputs if each.enabled and each.name == "Value")
        self.tree.links.new(self.position, value)
        self.tree.links.new(self.named(name, "INT"), node.inputs["Index"])
        return next(each for each in node.outputs if each.enabled and each.name == "Value")

    def root(self) -> Any:
        """Where the rig has the vertices' roots."""
        points = [self.point_of(name) for name in ROOT]
        weights = self.split(self.named(WEIGHTS, "FLOAT_VECTOR"))
        return self.sum([self.scaled(p, w) for p, w in zip(points, weights, strict=True)])

    def placed(self, geometry: Any, position: Any) -> Any:
        """A geometry whose vertices are moved to ``position``."""
        place = self.tree.nodes.new("GeometryNodeSetPosition")
        self.tree.links.new(geometry, place.inputs["Geometry"])
        self.tree.links.new(position, place.inputs["Position"])
        return place.outputs["Geometry"]
