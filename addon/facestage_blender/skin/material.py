"""The skin's material: the fit's reflectance (contract/brdf.py) as Cycles nodes, and its
textures.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import bpy
import numpy as np

from facestage.contract.brdf import F0, K_DIFFUSE, SPECULAR_MAX
from facestage.contract.face_model import OTHER, PARTS, SKIN, FaceModel
from facestage.contract.scattering import METRES, RADIUS_MM, STRENGTH_MAX, TRANSLUCENCY_MAX
from facestage.contract.texture_maps import (
    ALBEDO,
    BESIDE_MAPS,
    EYE_MAP,
    NORMAL,
    PLAIN,
    REFLECTANCE_MAPS,
    TEXTURE_MAPS,
    TextureMap,
)

from ..pictures.images import texture_image
from ..pictures.texture import paint_vertices
from .eye_material import show_eyes
from .uneven_skin import emerging

GROUP = "Facestage Skin"
SUBSURFACE, SCATTERING = "Subsurface", "Scattering"  # the switch, and how far light wanders
TRANSLUCENCY = "Translucency"  # how unevenly light comes out where the switch is off
BSDF, IN_EEVEE = "BSDF", "BSDF in EEVEE"  # the group's outputs, for all engines and for that one
SCATTERS = "facestage_scatters"  # of the group's node: whether it is skin, not eyes or teeth
NORMAL_NODE = "Normal Map"
PORES = "Pores"  # the bump of pores.py, which lies between the normal map and the group
WRINKLES = "Wrinkles"  # the sum of wrinkles.py, which lies before the pores
IRIS = "Iris behind the Cornea"  # the nodes of iris_depth.py, which have normals of their own
TEXTURE_SIZE, GLOSS_SIZE = 256, 32  # of a rig without a result


def skin_group() -> bpy.types.NodeTree:
    """The shared node group: diffuse K_DIFFUSE * albedo, more of it at a slant and of bulges
    (contract/scattering.py); where subsurface scattering is switched on light comes out of the skin
    elsewhere, and as unevenly by itself, but in EEVEE, which only blurs it and has an output of its
    own; plus c_spec times a GGX lobe with Schlick's F0.

    A metallic Principled BSDF with a white edge tint is exactly GGX with Schlick Fresnel of its
    base color. A mix against nothing scales it by 0..1; two of them reach SPECULAR_MAX.
    """
    group = bpy.data.node_groups.get(GROUP)
    if group is None:
        group = bpy.data.node_groups.new(GROUP, "ShaderNodeTree")
        for each in REFLECTANCE_MAPS:
            kind = "NodeSocketColor" if each.colored else "NodeSocketFloat"
            socket = group.interface.new_socket(each.socket, in_out="INPUT", socket_type=kind)
            socket.default_value = (*each.default, 1.0) if each.colored else each.default[0]
            if not each.colored:
                socket.min_value, socket.max_value = 0.0, each.most
        group.interface.new_socket(BSDF, in_out="OUTPUT", socket_type="NodeSocketShader")
    known = group.interface.items_tree
    below = {SUBSURFACE: 1.0, SCATTERING: STRENGTH_MAX, TRANSLUCENCY: TRANSLUCENCY_MAX}
    missing = [name for name in below if name not in known]
    if not missing and NORMAL.socket in known and IN_EEVEE in known:
        return group
    # New, or of an older version.
    for name in missing:
        socket = group.interface.new_socket(name, in_out="INPUT", socket_type="NodeSocketFloat")
        socket.default_value, socket.min_value, socket.max_value = 0.0, 0.0, below[name]
    if NORMAL.socket not in known:
        kind = "NodeSocketVector"
        group.interface.new_socket(
            NORMAL.socket, in_out="INPUT", socket_type=kind
        ).hide_value = True
    if IN_EEVEE not in known:
        group.interface.new_socket(IN_EEVEE, in_out="OUTPUT", socket_type="NodeSocketShader")
    group.nodes.clear()
    _wire_group(group)
    return group


def _wire_group(group: bpy.types.NodeTree) -> None:
    nodes, links = group.nodes, group.links
    inputs, output = (
        node_at(nodes, "NodeGroupInput", -900, 0),
        node_at(nodes, "NodeGroupOutput", 700, 0),
    )

    scale = node_at(nodes, "ShaderNodeVectorMath", -600, 250)
    scale.operation = "SCALE"
    scale.inputs["Scale"].default_value = K_DIFFUSE
    links.new(inputs.outputs["Albedo"], scale.inputs[0])
    diffuse = node_at(nodes, "ShaderNodeBsdfDiffuse", -350, 250)
    diffuse.inputs["Roughness"].default_value = 0.0
    normal = _normal_or_smooth(nodes, links, inputs.outputs[NORMAL.socket])
    # A random walk is uneven by itself, a blur is as uneven as a random walk if it is made so.
    strength = node_at(nodes, "ShaderNodeMix", -1200, 400)
    links.new(inputs.outputs[SUBSURFACE], strength.inputs["Factor"])
    links.new(inputs.outputs[TRANSLUCENCY], strength.inputs["A"])
    strength.inputs["B"].default_value = 1.0
    uneven = emerging(group, strength.outputs["Result"], normal, scale.outputs["Vector"])
    links.new(uneven, diffuse.inputs["Color"])

    lobe = node_at(nodes, "ShaderNodeBsdfPrincipled", -600, 0)
    lobe.distribution = "GGX"
    lobe.inputs["Base Color"].default_value = (F0, F0, F0, 1.0)
    lobe.inputs["Metallic"].default_value = 1.0
    lobe.inputs["Specular Tint"].default_value = (1.0, 1.0, 1.0, 1.0)
    links.new(inputs.outputs["Roughness"], lobe.inputs["Roughness"])
    for shader in (diffuse, lobe):
        links.new(normal, shader.inputs["Normal"])

    shares = []
    for step in range(int(SPECULAR_MAX)):
        share = node_at(nodes, "ShaderNodeMath", -350, -300 - 200 * step)
        share.operation, share.use_clamp = "SUBTRACT", True
        share.inputs[1].default_value = float(step)
        links.new(inputs.outputs["Specular"], share.inputs[0])
        mix = node_at(nodes, "ShaderNodeMixShader", -100, -200 * step)
        links.new(share.outputs[0], mix.inputs["Fac"] if "Fac" in mix.inputs else mix.inputs[0])
        links.new(lobe.outputs["BSDF"], mix.inputs[2])
        shares.append(mix.outputs[0])

    for name, y, color in ((BSDF, 550, scale.outputs["Vector"]), (IN_EEVEE, 800, uneven)):
        below = node_at(nodes, "ShaderNodeSubsurfaceScattering", -350, y)
        below.falloff = "RANDOM_WALK_SKIN"
        below.inputs["Radius"].default_value = [METRES * each for each in RADIUS_MM]
        links.new(color, below.inputs["Color"])
        links.new(inputs.outputs[SCATTERING], below.inputs["Scale"])
        links.new(normal, below.inputs["Normal"])
        body = node_at(nodes, "ShaderNodeMixShader", -100, y - 200)
        links.new(inputs.outputs[SUBSURFACE], body.inputs[0])
        links.new(diffuse.outputs["BSDF"], body.inputs[1])
        links.new(below.outputs["BSSRDF"], body.inputs[2])
        total = body.outputs[0]
        for step, share in enumerate(shares):
            add = node_at(nodes, "ShaderNodeAddShader", 200 + 220 * step, y - 450 - 100 * step)
            links.new(total, add.inputs[0])
            links.new(share, add.inputs[1])
            total = add.outputs[0]
        links.new(total, output.inputs[name])


def _normal_or_smooth(
    nodes: bpy.types.Nodes, links: bpy.types.NodeLinks, given: bpy.types.NodeSocket
) -> bpy.types.NodeSocket:
    """The normal that is given; the mesh's own where none is, which a group's input says as 0."""
    length = node_at(nodes, "ShaderNodeVectorMath", -900, 800)
    length.operation = "LENGTH"
    links.new(given, length.inputs[0])
    is_given = node_at(nodes, "ShaderNodeMath", -750, 800)
    is_given.operation = "GREATER_THAN"
    is_given.inputs[1].default_value = 0.5
    links.new(length.outputs["Value"], is_given.inputs[0])
    chosen = node_at(nodes, "ShaderNodeMix", -600, 800)
    chosen.data_type = "VECTOR"
    smooth = node_at(nodes, "ShaderNodeNewGeometry", -900, 1000)
    links.new(is_given.outputs[0], chosen.inputs["Factor"])
    a, b = (
        next(each for each in chosen.inputs if each.name == name and each.type == "VECTOR")
        for name in "AB"
    )
    links.new(smooth.outputs["Normal"], a)
    links.new(given, b)
    return next(each for each in chosen.outputs if each.type == "VECTOR")


def part_materials(parts: np.ndarray, uv_map: str = "") -> list[bpy.types.Material]:
    """A new material for each part of the face (indices into PARTS): the skin's, or nothing for
    see-through shells.

    uv_map: the UV map of its textures; empty for the mesh's active one.
    """
    return [
        _see_through()
        if part == OTHER
        else _part_material(f"Facestage {PARTS[part].capitalize()}", uv_map, part == SKIN)
        for part in parts
    ]


def plain_material(
    name: str, color: tuple[float, float, float], roughness: float
) -> bpy.types.Material:
    """A new dielectric material of one color (linear RGB), for what is not skin."""
    material, nodes, links = empty_material(name)
    surface = node_at(nodes, "ShaderNodeBsdfPrincipled", 0, 0)
    surface.inputs["Base Color"].default_value = (*color, 1.0)
    surface.inputs["Roughness"].default_value = roughness
    output = node_at(nodes, "ShaderNodeOutputMaterial", 300, 0)
    links.new(surface.outputs["BSDF"], output.inputs["Surface"])
    return material


def _see_through() -> bpy.types.Material:
    """Tear film, lashes and the like: the fit does not trace them, so they must not hide the
    eyes.
    """
    material, nodes, links = empty_material(f"Facestage {PARTS[OTHER].capitalize()}")
    output = node_at(nodes, "ShaderNodeOutputMaterial", 300, 0)
    links.new(
        node_at(nodes, "ShaderNodeBsdfTransparent", 0, 0).outputs["BSDF"], output.inputs["Surface"]
    )
    return material


def empty_material(name: str) -> tuple[bpy.types.Material, Any, Any]:
    """A new material, its nodes (none) and its links."""
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # before Blender 5.0 a new material has no nodes
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, material.node_tree.nodes, material.node_tree.links


def _part_material(name: str, uv_map: str, scatters: bool) -> bpy.types.Material:
    material, nodes, links = empty_material(name)
    skin = node_at(nodes, "ShaderNodeGroup", 0, 0)
    skin.node_tree, skin.name, skin.width = skin_group(), GROUP, 200
    skin[SCATTERS] = bool(scatters)
    output = node_at(nodes, "ShaderNodeOutputMaterial", 300, 0)
    links.new(skin.outputs[BSDF], output.inputs["Surface"])
    if scatters:
        _show_in_eevee(material)
    for each in TEXTURE_MAPS:
        node = picture_node(material, each, uv_map)
        if each.required:  # others are linked where there is an image
            links.new(node.outputs["Color"], skin.inputs[each.socket])
    nodes.active = nodes[ALBEDO.socket]  # the picture that Solid views show
    return material


def _show_in_eevee(material: bpy.types.Material) -> None:
    """Give EEVEE what the skin's group has for it, where the group alone is what is shown."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    shown = [link.to_node.type for link in nodes[GROUP].outputs[BSDF].links]
    if IN_EEVEE not in nodes and shown == ["OUTPUT_MATERIAL"]:
        output = node_at(nodes, "ShaderNodeOutputMaterial", 300, -200)
        output.name, output.target = IN_EEVEE, "EEVEE"
        links.new(nodes[GROUP].outputs[IN_EEVEE], output.inputs["Surface"])


def picture_node(
    material: bpy.types.Material, each: TextureMap, uv_map: str
) -> bpy.types.ShaderNodeTexImage:
    """The material's image node of a map, made where there is none."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    if each.socket in nodes:
        return nodes[each.socket]
    row = TEXTURE_MAPS.index(each)
    node = node_at(nodes, "ShaderNodeTexImage", -700, 100 - 320 * row)
    node.name = node.label = each.socket
    node.interpolation, node.extension = "Linear", "EXTEND"
    if uv_map:
        uvs = node_at(nodes, "ShaderNodeUVMap", -950, 100 - 320 * row)
        uvs.uv_map = uv_map
        links.new(uvs.outputs["UV"], node.inputs["Vector"])
    return node


def bend_normals(material: bpy.types.Material, image: bpy.types.Image | None) -> None:
    """Turn a material's normals as a normal map says, or no more."""
    nodes, links = material.node_tree.nodes, material.node_tree.links
    if NORMAL.socket not in nodes[GROUP].inputs or IRIS in nodes:
        return  # a group that its user has made another of, or eyes that are flat in the map
    bent = bent_socket(nodes)
    if WRINKLES in nodes:
        bent = nodes[WRINKLES].inputs[0]
    for link in list(bent.links):
        links.remove(link)
    if image is None:
        if WRINKLES in nodes:
            links.new(smooth_normal(nodes), bent)
        return
    uv_map = textures_uv_map(nodes)
    node = picture_node(material, NORMAL, uv_map)
    node.image = image
    if NORMAL_NODE not in nodes:
        nodes.new("ShaderNodeNormalMap").name = NORMAL_NODE
        nodes[NORMAL_NODE].location = (-350, 100 - 320 * TEXTURE_MAPS.index(NORMAL))
    nodes[NORMAL_NODE].uv_map = uv_map
    links.new(node.outputs["Color"], nodes[NORMAL_NODE].inputs["Color"])
    links.new(nodes[NORMAL_NODE].outputs["Normal"], bent)


def bent_socket(nodes: bpy.types.Nodes) -> bpy.types.NodeSocket:
    """Where a material takes the normals that it has been given so far: before its pores."""
    return nodes[PORES].inputs["Normal"] if PORES in nodes else nodes[GROUP].inputs[NORMAL.socket]


def smooth_normal(nodes: bpy.types.Nodes) -> bpy.types.NodeSocket:
    """The mesh's own normal."""
    found = next((node for node in nodes if node.type == "NEW_GEOMETRY"), None)
    if found is None:
        found = node_at(nodes, "ShaderNodeNewGeometry", -700, 700)
    return found.outputs["Normal"]


def textures_uv_map(nodes: bpy.types.Nodes) -> str:
    """The UV map that a material's pictures lie over; empty for the mesh's active one."""
    return next((node.uv_map for node in nodes if node.type == "UVMAP"), "")


def set_textures(
    rig: bpy.types.Object, images: Mapping[str, bpy.types.Image], plain: Mapping[str, float]
) -> None:
    """Give all materials of a rig these textures by name; images used no more are removed.

    Where a map is missing the skin has one value: that of its parameter in ``plain``.
    """
    face = rig.facestage_face
    maps = (*TEXTURE_MAPS, *BESIDE_MAPS)
    before = [getattr(face, f"{each.name}_image") for each in maps]
    retired = [image for image in before if image is not None and image not in images.values()]
    for each in maps:
        setattr(face, f"{each.name}_image", images.get(each.name))
    for name, value in plain.items():
        setattr(face, name, value)
    skin_group()  # also where it is of an older version
    for slot in rig.material_slots:
        material = slot.material
        if material is None or material.node_tree is None:
            continue
        nodes, links = material.node_tree.nodes, material.node_tree.links
        for each in TEXTURE_MAPS:
            if each.socket in nodes:
                nodes[each.socket].image = images.get(each.name)
        if GROUP not in nodes:
            continue
        bend_normals(material, images.get(NORMAL.name))
        for each in REFLECTANCE_MAPS:
            image = images.get(each.name)
            if each.required:
                continue
            socket = nodes[GROUP].inputs[each.socket]
            if each.plain is not None:
                socket.default_value = plain[each.plain]
            for link in list(socket.links):
                links.remove(link)
            if image is not None and each.socket in nodes:
                links.new(nodes[each.socket].outputs["Color"], socket)
    show_eyes(rig, images.get(EYE_MAP.name))
    for image in retired:
        if not image.users:
            bpy.data.images.remove(image)


def skin_nodes(rig: bpy.types.Object) -> list[tuple[bpy.types.NodeTree, Any]]:
    """The node trees of a rig's skin, not of eyes and teeth, and the skin group's node in each."""
    found = []
    for slot in rig.material_slots:
        tree = None if slot.material is None else slot.material.node_tree
        node = None if tree is None else tree.nodes.get(GROUP)
        if node is not None and node.get(SCATTERS):
            found.append((tree, node))
    return found


def set_scattering(rig: bpy.types.Object, strength: float, translucency: float = 0.0) -> None:
    """Let light wander below the skin of a rig ``strength`` times as far as published; 0: switch
    it off, so that light comes out where it went in, as unevenly as ``translucency`` says.
    """
    skin_group()  # also where it is of an older version
    for slot in rig.material_slots:
        tree = None if slot.material is None else slot.material.node_tree
        node = None if tree is None else tree.nodes.get(GROUP)
        # Older versions named the parts' materials alone.
        if node is not None and node.get(SCATTERS, slot.material.name.startswith(GROUP)):
            _show_in_eevee(slot.material)  # which materials of older versions lack
            node.inputs[SUBSURFACE].default_value = float(strength > 0)
            node.inputs[TRANSLUCENCY].default_value = translucency
            if strength > 0:
                node.inputs[SCATTERING].default_value = strength


def paint_albedo(model: FaceModel) -> np.ndarray:
    """(h, w, 3) float32 the model's mean albedo, linear RGB, row 0 at v = 1: what
    :func:`show_model` shows, and what takes longest of building a rig.
    """
    return paint_vertices(
        model.albedo(), model.triangles, model.uvs, model.triangle_uvs, TEXTURE_SIZE
    )


def show_model(rig: bpy.types.Object, albedo: np.ndarray) -> None:
    """Give a rig what its face model alone knows of the skin: the mean ``albedo`` (h, w, 3), linear
    RGB, and one gloss.
    """
    images = {}
    for each in TEXTURE_MAPS:
        if each.required:
            values = np.full((GLOSS_SIZE, GLOSS_SIZE), each.default[0], np.float32)
            image = texture_image(f"Facestage {each.socket}", albedo if each.colored else values)
            images[each.name] = image
    set_textures(rig, images, {name: getattr(rig.facestage_face, name) for name in PLAIN})


def node_at(nodes: bpy.types.Nodes, kind: str, x: float, y: float) -> bpy.types.Node:
    """A new node of a kind, placed."""
    node = nodes.new(kind)
    node.location = (x, y)
    return node
