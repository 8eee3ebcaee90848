"""The iris behind the cornea: it lies flat, below the eyeball's surface on which a face model has
it, and is seen there as water bends the view.

Nodes in the material of the eyes, between its texture coordinates and its picture; both engines
have them. The highlight goes over to the cornea.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from facestage.contract.texture_maps import ALBEDO, EYE_MAP, NORMAL

from .eye_material import MATERIAL, render_uvs
from .lids import group_members, opposite_pair, rest_points
from .material import GROUP, IRIS, bend_normals, skin_group
from .vector_nodes import VectorNodes

DEPTH, LEAN = "facestage_iris_depth", "facestage_iris_lean"  # of the rig's vertices
IRIS_RADIUS = 0.0059  # metres
INDEX = 1.336  # of the water between cornea and iris
BELOW = 0.0003  # how far below its rim the iris lies, metres
# How much the iris' border is turned to the axis: what the cornea does to light, which gathers on
# the side away from the lamp.
HOLLOW = 0.35
SIDES = ("eye_left", "eye_right")
GLOSS = "Specular"


def sink_iris(rig: bpy.types.Object) -> None:
    """Let the eyes' material show the iris where it is seen through a cornea."""
    flatten_iris(rig)
    skin_group()  # also where it is of an older version
    scale = _measure(rig)
    for material in _materials(rig):
        _insert(material, scale)


def flatten_iris(rig: bpy.types.Object) -> None:
    """Undo it."""
    for material in _materials(rig):
        tree = material.node_tree
        frame = tree.nodes.get(IRIS)
        if frame is None:
            continue
        bend = tree.nodes.get(f"{IRIS} offset")
        source = bend.inputs[0].links[0].from_socket
        for link in list(bend.outputs[0].links):
            tree.links.new(source, link.to_socket)
        for each in [node for node in tree.nodes if node.parent == frame]:
            tree.nodes.remove(each)
        tree.nodes.remove(frame)
        bend_normals(material, rig.facestage_face.normal_image)
        if GLOSS in tree.nodes:
            tree.links.new(tree.nodes[GLOSS].outputs["Color"], tree.nodes[GROUP].inputs[GLOSS])
    for name in (DEPTH, LEAN):
        if name in rig.data.attributes:
            rig.data.attributes.remove(rig.data.attributes[name])


def _materials(rig: bpy.types.Object) -> list[bpy.types.Material]:
    found = [slot.material for slot in rig.material_slots if slot.material is not None]
    return [
        each
        for each in found
        if each.name.startswith(MATERIAL)
        and each.node_tree is not None
        and {GROUP, ALBEDO.socket} <= set(each.node_tree.nodes.keys())
    ]


def _measure(rig: bpy.types.Object) -> tuple[float, float]:
    """Set the eyeballs' attributes; returns how far u and v go a metre, on irises."""
    mesh = rig.data
    points = rest_points(mesh)
    depth, lean = np.zeros(len(points)), np.zeros((len(points), 3))
    corners = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", corners)
    uvs, layer = np.zeros(2 * len(mesh.loops), np.float32), render_uvs(mesh)
    if layer is not None:
        layer.uv.foreach_get("vector", uvs)
    uvs = uvs.reshape(-1, 2)
    scales = []
    for side in SIDES:
        ball = group_members(rig, side)
        pair = points[list(opposite_pair(points, ball))]
        centre = pair.mean(axis=0)
        # To its left and up, and forward.
        across, forward = points[ball][:, [0, 2]] - centre[[0, 2]], centre[1] - points[ball, 1]
        radius = np.hypot(*across.T)
        front = forward > 0.3 * np.linalg.norm(pair[0] - centre)
        outer = front & (forward >= _outer(radius, forward, front) - 0.0003)
        rim = _level(radius[outer], forward[outer])
        depth[ball] = np.where(outer & (radius < IRIS_RADIUS), forward - rim + BELOW, 0.0)
        depth[ball] = np.maximum(depth[ball], 0)
        inside = np.isin(corners, ball[outer & (radius < IRIS_RADIUS)])
        place = points[corners[inside]][:, [0, 2]] - centre[[0, 2]]
        given = np.column_stack([place, np.ones(len(place))])
        (along_x, along_z, _) = np.linalg.lstsq(given, uvs[inside], rcond=None)[0]
        jacobian = np.stack([along_x, along_z])  # (x z, u v)
        lengths = np.linalg.norm(jacobian, axis=0)
        scales.append(lengths)
        share = np.clip(radius / IRIS_RADIUS, 0, 1)
        fade = np.clip((1.06 - radius / IRIS_RADIUS) / 0.12, 0, 1) * outer
        # Turned from the eyeball's own normal to that of a plane, and on to that of a bowl.
        tilt = (
            -(across / max(np.linalg.norm(pair[0] - centre), 1e-6))
            - HOLLOW * (across / np.maximum(radius, 1e-9)[:, None]) * share[:, None]
        )
        lean[ball, :2] = fade[:, None] * (tilt @ (jacobian / np.maximum(lengths, 1e-9)))
    for name, kind, field, values in (
        (DEPTH, "FLOAT", "value", depth),
        (LEAN, "FLOAT_VECTOR", "vector", lean),
    ):
        attribute = mesh.attributes.get(name) or mesh.attributes.new(name, kind, "POINT")
        attribute.data.foreach_set(field, values.astype(np.float32).ravel())
    across_u, across_v = np.mean(scales, axis=0).tolist()
    return across_u, across_v


def _outer(radius: np.ndarray, forward: np.ndarray, front: np.ndarray) -> np.ndarray:
    """How far forward the outermost of an eyeball's shells is at each vertex' radius."""
    near = np.abs(radius[:, None] - radius[None]) < 0.0006
    return np.where(near & front[None], forward[None], -np.inf).max(axis=1)


def _level(radius: np.ndarray, forward: np.ndarray) -> float:
    """How far forward the iris' rim is."""
    order = np.argsort(radius)
    return float(np.interp(IRIS_RADIUS, radius[order], forward[order]))


def _insert(material: bpy.types.Material, scale: tuple[float, float]) -> None:
    tree = material.node_tree
    before = set(tree.nodes)
    picture, group = tree.nodes[ALBEDO.socket], tree.nodes[GROUP]
    given = tree.nodes.get(EYE_MAP.socket, picture).inputs["Vector"]
    if given.is_linked:
        source = given.links[0].from_socket
    else:
        source = tree.nodes.new("ShaderNodeTexCoord").outputs["UV"]
        before.update(tree.nodes)
    build = VectorNodes(tree)
    uv_map = next((node.uv_map for node in tree.nodes if node.type == "UVMAP"), "")
    along_u, along_v = (
        _axis(tree, color, uv_map) for color in ((1.0, 0.5, 0.5, 1.0), (0.5, 1.0, 0.5, 1.0))
    )
    geometry = tree.nodes.new("ShaderNodeNewGeometry")
    view, normal = geometry.outputs["Incoming"], geometry.outputs["Normal"]
    depth = tree.nodes.new("ShaderNodeAttribute")
    depth.attribute_name = DEPTH
    # Snell: what is across the normal of the direction to the eye, divided by the index.
    seen = [build.math("DOT_PRODUCT", view, axis) for axis in (along_u, along_v)]
    bent = [build.number("DIVIDE", each, INDEX) for each in seen]
    squares = [build.number("MULTIPLY", each, each) for each in bent]
    straight = build.number("SQRT", build.number("SUBTRACT", 1.0, build.number("ADD", *squares)))
    run = build.number("DIVIDE", depth.outputs["Fac"], straight)
    moved = [
        build.number("MULTIPLY", build.number("MULTIPLY", each, run), -size)
        for each, size in zip(bent, scale, strict=True)
    ]
    offset = build.math("ADD", source, build.joined(*moved, 0.0))
    offset.node.name = f"{IRIS} offset"
    tree.links.new(offset, given)
    lean = tree.nodes.new("ShaderNodeAttribute")
    lean.attribute_name = LEAN
    by_u, by_v, _ = build.split(lean.outputs["Vector"])
    turned = build.sum([normal, build.scaled(along_u, by_u), build.scaled(along_v, by_v)])
    tree.links.new(build.math("NORMALIZE", turned), group.inputs[NORMAL.socket])
    for link in list(group.inputs[GLOSS].links):
        tree.links.remove(link)
    group.inputs[GLOSS].default_value = 0.0
    frame = tree.nodes.new("NodeFrame")
    frame.name = frame.label = IRIS
    for index, each in enumerate(node for node in set(tree.nodes) - before if node != frame):
        each.parent, each.hide = frame, True
        each.location = (-1600 + 160 * (index % 5), 700 + 40 * (index // 5))


def _axis(tree: bpy.types.NodeTree, color: tuple[float, ...], uv_map: str) -> Any:
    """The direction in space in which u, or v, grows: what a normal map of one color would say."""
    node = tree.nodes.new("ShaderNodeNormalMap")
    node.uv_map = uv_map
    node.inputs["Color"].default_value = color
    return node.outputs["Normal"]
