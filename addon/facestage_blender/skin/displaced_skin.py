"""Skin displaced by its height map instead of shaded by its normal map: for close-ups in Cycles."""

from __future__ import annotations

import bpy

from facestage.contract.errors import InputError
from facestage.contract.texture_maps import HEIGHT

from .material import GROUP, bend_normals, picture_node, textures_uv_map

MODIFIER, NODE = "Facestage Relief", "Relief"
MILLIMETRE = 1e-3  # of Blender's metres
LEVELS = 3  # of subdivision in a render where Blender has no adaptive one
PIXELS = 1.0  # that an edge of the adaptive one has


def is_displaced(rig: bpy.types.Object) -> bool:
    """Whether the rig's skin is."""
    return MODIFIER in rig.modifiers


def displace(rig: bpy.types.Object, on: bool) -> None:
    """Give the rig's skin its relief by displacement, on a mesh that Cycles divides as finely as
    the picture needs, or by its normal map again. Raises InputError without a height map.
    """
    face = rig.facestage_face
    if on and face.height_image is None:
        raise InputError(
            "The face has no height map: the photo showed no relief, or the result is of an older "
            "version; fit again, best with several photos in different light."
        )
    if not on and is_displaced(rig):
        rig.modifiers.remove(rig.modifiers[MODIFIER])
    if on and not is_displaced(rig):
        modifier = rig.modifiers.new(MODIFIER, "SUBSURF")
        modifier.levels, modifier.render_levels = 0, LEVELS
        if hasattr(modifier, "use_adaptive_subdivision"):  # Blender 5.0 and later
            modifier.use_adaptive_subdivision = True
            modifier.adaptive_pixel_size = PIXELS
    for slot in rig.material_slots:
        material = slot.material
        tree = None if material is None else material.node_tree
        if tree is not None and GROUP in tree.nodes:
            _displace(material, face.height_image if on else None)
            bend_normals(material, None if on else face.normal_image)


def _displace(material: bpy.types.Material, image: bpy.types.Image | None) -> None:
    nodes, links = material.node_tree.nodes, material.node_tree.links
    outputs = [node.inputs["Displacement"] for node in nodes if node.type == "OUTPUT_MATERIAL"]
    for link in [link for output in outputs for link in output.links]:
        if link.from_node.name == NODE:
            links.remove(link)
    # Blender 4.1 and later have it; before, it was one of Cycles' own settings.
    owner = material if hasattr(material, "displacement_method") else material.cycles
    owner.displacement_method = "BUMP" if image is None else "DISPLACEMENT"
    if image is None:
        return
    picture = picture_node(material, HEIGHT, textures_uv_map(nodes))
    picture.image = image
    if NODE not in nodes:
        nodes.new("ShaderNodeDisplacement").name = NODE
        nodes[NODE].location = (0, -400)
    nodes[NODE].inputs["Midlevel"].default_value = 0.0
    nodes[NODE].inputs["Scale"].default_value = MILLIMETRE
    links.new(picture.outputs["Color"], nodes[NODE].inputs["Height"])
    for output in outputs:
        links.new(nodes[NODE].outputs["Displacement"], output)
