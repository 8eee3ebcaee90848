"""The skin's material: the fit's reflectance (contract/brdf.py) as Cycles nodes, and its
textures.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from facestage.contract.brdf import F0, K_DIFFUSE, SPECULAR_MAX
from facestage.contract.face_model import OTHER, PARTS

GROUP = "Facestage Skin"
TEXTURES = ("Albedo", "Specular", "Roughness")  # the roughness map is linked where there is one


def skin_group() -> bpy.types.NodeTree:
    """The shared node group: diffuse K_DIFFUSE * albedo, plus c_spec times a GGX lobe with
    Schlick's F0.

    A metallic Principled BSDF with a white edge tint is exactly GGX with Schlick Fresnel of its
    base color. A mix against nothing scales it by 0..1; two of them reach SPECULAR_MAX.
    """
    group = bpy.data.node_groups.get(GROUP)
    if group is not None:
        return group
    group = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
    sockets = (
        ("Albedo", "Color", (0.5, 0.3, 0.2, 1.0)),
        ("Specular", "Float", 1.0),
        ("Roughness", "Float", 0.45),
    )
    for name, kind, default in sockets:
        socket = group.interface.new_socket(name, in_out="INPUT", socket_type=f"NodeSocket{kind}")
        socket.default_value = default
        if kind == "Float":
            socket.min_value, socket.max_value = 0.0, SPECULAR_MAX if name == "Specular" else 1.0
    group.interface.new_socket("BSDF", in_out="OUTPUT", socket_type="NodeSocketShader")
    _wire_group(group)
    return group


def _wire_group(group: bpy.types.NodeTree) -> None:
    nodes, links = group.nodes, group.links
    inputs, output = (
        _node(nodes, "NodeGroupInput", -900, 0),
        _node(nodes, "NodeGroupOutput", 700, 0),
    )

    scale = _node(nodes, "ShaderNodeVectorMath", -600, 250)
    scale.operation = "SCALE"
    scale.inputs["Scale"].default_value = K_DIFFUSE
    links.new(inputs.outputs["Albedo"], scale.inputs[0])
    diffuse = _node(nodes, "ShaderNodeBsdfDiffuse", -350, 250)
    diffuse.inputs["Roughness"].default_value = 0.0
    links.new(scale.outputs["Vector"], diffuse.inputs["Color"])

    lobe = _node(nodes, "ShaderNodeBsdfPrincipled", -600, 0)
    lobe.distribution = "GGX"
    lobe.inputs["Base Color"].default_value = (F0, F0, F0, 1.0)
    lobe.inputs["Metallic"].default_value = 1.0
    lobe.inputs["Specular Tint"].default_value = (1.0, 1.0, 1.0, 1.0)
    links.new(inputs.outputs["Roughness"], lobe.inputs["Roughness"])

    total = diffuse.outputs["BSDF"]
    for step in range(int(SPECULAR_MAX)):
        share = _node(nodes, "ShaderNodeMath", -350, -300 - 200 * step)
        share.operation, share.use_clamp = "SUBTRACT", True
        share.inputs[1].default_value = float(step)
        links.new(inputs.outputs["Specular"], share.inputs[0])
        mix = _node(nodes, "ShaderNodeMixShader", -100, -200 * step)
        links.new(share.outputs[0], mix.inputs["Fac"] if "Fac" in mix.inputs else mix.inputs[0])
        links.new(lobe.outputs["BSDF"], mix.inputs[2])
        add = _node(nodes, "ShaderNodeAddShader", 200 + 220 * step, 100 - 100 * step)
        links.new(total, add.inputs[0])
        links.new(mix.outputs[0], add.inputs[1])
        total = add.outputs[0]
    links.new(total, output.inputs["BSDF"])


def part_materials(parts: np.ndarray, uv_map: str = "") -> list[bpy.types.Material]:
    """A new material for each part of the face (indices into PARTS): the skin's, or nothing for
    see-through shells.

    uv_map: the UV map of its textures; empty for the mesh's active one.
    """
    return [
        _see_through()
        if part == OTHER
        else _part_material(f"Facestage {PARTS[part].capitalize()}", uv_map)
        for part in parts
    ]


def plain_material(
    name: str, color: tuple[float, float, float], roughness: float
) -> bpy.types.Material:
    """A new dielectric material of one color (linear RGB), for what is not skin."""
    material, nodes, links = _empty_material(name)
    surface = _node(nodes, "ShaderNodeBsdfPrincipled", 0, 0)
    surface.inputs["Base Color"].default_value = (*color, 1.0)
    surface.inputs["Roughness"].default_value = roughness
    output = _node(nodes, "ShaderNodeOutputMaterial", 300, 0)
    links.new(surface.outputs["BSDF"], output.inputs["Surface"])
    return material


def _see_through() -> bpy.types.Material:
    """Tear film, lashes and the like: the fit does not trace them, so they must not hide the
    eyes.
    """
    material, nodes, links = _empty_material(f"Facestage {PARTS[OTHER].capitalize()}")
    output = _node(nodes, "ShaderNodeOutputMaterial", 300, 0)
    links.new(
        _node(nodes, "ShaderNodeBsdfTransparent", 0, 0).outputs["BSDF"], output.inputs["Surface"]
    )
    return material


def _empty_material(name: str) -> tuple[bpy.types.Material, Any, Any]:
    """A new material, its nodes (none) and its links."""
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # before Blender 5.0 a new material has no nodes
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, material.node_tree.nodes, material.node_tree.links


def _part_material(name: str, uv_map: str) -> bpy.types.Material:
    material, nodes, links = _empty_material(name)
    skin = _node(nodes, "ShaderNodeGroup", 0, 0)
    skin.node_tree, skin.name, skin.width = skin_group(), GROUP, 200
    output = _node(nodes, "ShaderNodeOutputMaterial", 300, 0)
    links.new(skin.outputs["BSDF"], output.inputs["Surface"])
    for row, texture in enumerate(TEXTURES):
        node = _node(nodes, "ShaderNodeTexImage", -400, 100 - 320 * row)
        node.name = node.label = texture
        node.interpolation, node.extension = "Linear", "EXTEND"
        if texture != "Roughness":
            links.new(node.outputs["Color"], skin.inputs[texture])
        if uv_map:
            uvs = _node(nodes, "ShaderNodeUVMap", -650, 100 - 320 * row)
            uvs.uv_map = uv_map
            links.new(uvs.outputs["UV"], node.inputs["Vector"])
    return material


def set_textures(
    rig: bpy.types.Object,
    albedo: bpy.types.Image,
    specular: bpy.types.Image,
    roughness: float,
    roughness_map: bpy.types.Image | None = None,
) -> None:
    """Give all materials of a rig these textures; images used no more are removed.

    Without a ``roughness_map`` the skin has the one value ``roughness``.
    """
    face, images = rig.facestage_face, (albedo, specular, roughness_map)
    before = (face.albedo_image, face.specular_image, face.roughness_image)
    retired = [image for image in before if image is not None and image not in images]
    face.albedo_image, face.specular_image, face.roughness_image = images
    face.roughness = roughness
    for slot in rig.material_slots:
        material = slot.material
        if material is None or material.node_tree is None:
            continue
        nodes, links = material.node_tree.nodes, material.node_tree.links
        for name, image in zip(TEXTURES, images, strict=True):
            if name in nodes:
                nodes[name].image = image
        if GROUP in nodes:
            socket = nodes[GROUP].inputs["Roughness"]
            socket.default_value = roughness
            for link in list(socket.links):
                links.remove(link)
            if roughness_map is not None and "Roughness" in nodes:
                links.new(nodes["Roughness"].outputs["Color"], socket)
    for image in retired:
        if not image.users:
            bpy.data.images.remove(image)


def _node(nodes: bpy.types.Nodes, kind: str, x: float, y: float) -> bpy.types.Node:
    node = nodes.new(kind)
    node.location = (x, y)
    return node
