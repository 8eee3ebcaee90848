"""The eyes' own picture: the same albedo in more texels, of their part of the UV square alone."""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.face_model import EYES, PARTS
from facestage.contract.texture_maps import ALBEDO, EYE_MAP, uv_box

IN_SOLID = "Albedo in Solid Views"
MATERIAL = f"Facestage {PARTS[EYES].capitalize()}"


def show_eyes(rig: bpy.types.Object, image: bpy.types.Image | None) -> None:
    """Let the material of the eyes show ``image``; None: the part of the albedo that is theirs."""
    for index, slot in enumerate(rig.material_slots):
        material = slot.material
        if material is None or material.node_tree is None:
            continue
        nodes = material.node_tree.nodes
        picture, place = nodes.get(ALBEDO.socket), nodes.get(EYE_MAP.socket)
        if picture is None or not material.name.startswith(MATERIAL):
            continue
        whole = nodes.get(IN_SOLID) or _whole_picture(nodes, picture)
        whole.image = rig.facestage_face.albedo_image
        nodes.active = whole
        left, bottom, right, top = 0.0, 0.0, 1.0, 1.0
        if image is not None:
            picture.image = image
            left, bottom, right, top = uv_box(material_uvs(rig.data, index))
        if place is None:
            if image is None:
                continue
            place = _placing_node(material.node_tree, picture)
        scale = np.array([1 / max(right - left, 1e-6), 1 / max(top - bottom, 1e-6)])
        place.inputs["Scale"].default_value = (*scale, 1.0)
        place.inputs["Location"].default_value = (-left * scale[0], -bottom * scale[1], 0.0)


def _whole_picture(nodes: bpy.types.Nodes, picture: bpy.types.Node) -> bpy.types.Node:
    """A node with the albedo of all parts for Solid views, which know nothing of a part's place."""
    whole = nodes.new("ShaderNodeTexImage")
    whole.name = whole.label = IN_SOLID
    whole.location = picture.location[0], picture.location[1] + 320
    return whole


def _placing_node(tree: bpy.types.NodeTree, picture: bpy.types.Node) -> bpy.types.Node:
    """A node before the ``picture`` that moves its texture coordinates."""
    place = tree.nodes.new("ShaderNodeMapping")
    place.name = place.label = EYE_MAP.socket
    place.location = picture.location[0] - 200, picture.location[1]
    given = picture.inputs["Vector"].links
    if given:
        source = given[0].from_socket
    else:
        coordinates = tree.nodes.new("ShaderNodeTexCoord")
        coordinates.location = place.location[0] - 200, place.location[1]
        source = coordinates.outputs["UV"]
    tree.links.new(source, place.inputs["Vector"])
    tree.links.new(place.outputs["Vector"], picture.inputs["Vector"])
    return place


def material_uvs(mesh: bpy.types.Mesh, index: int) -> np.ndarray:
    """(k, 2) the UV points of the polygons of a material slot."""
    layer = render_uvs(mesh)
    if layer is None:
        return np.zeros((0, 2), np.float32)
    uvs = np.empty(2 * len(mesh.loops), np.float32)
    layer.uv.foreach_get("vector", uvs)
    return uvs.reshape(-1, 2)[of_slot(mesh, index)]


def render_uvs(mesh: bpy.types.Mesh) -> bpy.types.MeshUVLoopLayer | None:
    """The UV map that is rendered, if there is one."""
    return next((each for each in mesh.uv_layers if each.active_render), None)


def of_slot(mesh: bpy.types.Mesh, index: int) -> np.ndarray:
    """(corners,) bool, which corners of polygons are of a material slot."""
    slot, total = (np.empty(len(mesh.polygons), np.int32) for _ in range(2))
    mesh.polygons.foreach_get("material_index", slot)
    mesh.polygons.foreach_get("loop_total", total)
    return np.repeat(slot == index, total)
