"""Pores and fine relief that no photo shows: a procedural layer, made up, over what was fitted.

Nothing of it is fitted, and exported files hold none. What its scales are from:

- Follicles, each the floor of a pore: 455 per cm^2 beside the forehead's middle, up to 1220 on the
  nose, fewer towards the sides (Pagnoni et al. 1994, "Determination of density of follicles on
  various regions of the face by cyanoacrylate biopsy"); 292 beside the forehead in Otberg et al.
  2004, "Variations of Hair Follicle Size and Distribution in Different Body Sites".
- Pores are seen as such from a diameter of 0.25 mm on (Flament et al. 2015, "Facial skin pores: a
  multiethnic study"): the widest have that.
- Relief between them: slopes along one axis of a scan's normal map in the octaves from 1 to 16 mm,
  0.018, 0.013, 0.011 and 0.010 (docs/textures.md); this has 0.015, 0.016, 0.011 and 0.009.

How deep pores are is a choice.
"""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.texture_maps import NORMAL

from .material import PORES, skin_nodes

MILLIMETRE = 1e-3  # of Blender's metres
DIAMETER_MM, DEPTH_MM = 0.25, 0.02
# Pores per mm^2 at the sides of the face and on the nose, and how far from the middle the
# latter's go.
SIDES, NOSE = 4.55, 12.2
MIDDLE_M = 0.025
# Pores and relief of skin outside the face, of its sides, and of its middle.
OUTSIDE, BESIDE, CENTRAL = 0.3, 0.6, 1.0
BARE = ("lips", "brows", "scalp", "eye_corners")  # regions with none, where a model names them
FACE = "face"
# Wavelength of the longest octave, octaves below it, the factor from each height to the next, and
# the noise's height at which its slopes are those above.
WAVELENGTH_MM, OCTAVES, FALL, HEIGHT_MM = 11.3, 3.0, 0.68, 0.62
REST, REGION = "facestage_rest", "facestage_pores"  # attributes of the rig's vertices


def pores_of(rig: bpy.types.Object) -> Any:
    """The socket that says how deep the rig's pores are, 0 to 1 for as deep as above; None: it has
    none.
    """
    for tree, _ in _skins(rig):
        if PORES in tree.nodes:
            return tree.nodes[PORES].inputs["Strength"]
    return None


def give_pores(rig: bpy.types.Object) -> None:
    """Give the skin of a rig pores. Raises InputError where it has no skin of Facestage's."""
    skins = _skins(rig)
    if not skins:
        raise InputError(
            "The rig's skin is not Facestage's, so it can have no pores; switch Facestage Skin "
            "on for it and apply the result."
        )
    _set_attributes(rig)
    for tree, normal in skins:
        if PORES not in tree.nodes:
            _insert(tree, normal)


def remove_pores(rig: bpy.types.Object) -> None:
    """Take the pores away again."""
    for tree, normal in _skins(rig):
        if PORES in tree.nodes:
            _remove(tree, tree.nodes[PORES], normal)
    for name in (REST, REGION):
        if name in rig.data.attributes:
            rig.data.attributes.remove(rig.data.attributes[name])


def _skins(rig: bpy.types.Object) -> list[tuple[bpy.types.NodeTree, Any]]:
    """The node trees of the rig's skin, and where each takes its normals."""
    return [
        (tree, node.inputs[NORMAL.socket])
        for tree, node in skin_nodes(rig)
        if NORMAL.socket in node.inputs
    ]


def _set_attributes(rig: bpy.types.Object) -> None:
    """Where each vertex of the rig lies at rest, and how much of a pore's depth it has and
    how central it is.
    """
    mesh = rig.data
    rest = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", rest)
    rest = rest.reshape(-1, 3)
    names = {group.index: group.name for group in rig.vertex_groups}
    face, bare = np.zeros(len(rest), bool), np.zeros(len(rest), bool)
    for vertex in mesh.vertices:
        mine = {names[entry.group] for entry in vertex.groups}
        face[vertex.index], bare[vertex.index] = FACE in mine, bool(mine.intersection(BARE))
    if not face.any():
        face[:] = True
    aside = rest[:, 0] - rest[face, 0].mean()
    central = np.where(face, np.exp(-((aside / MIDDLE_M) ** 2)), 0.0)
    depth = np.where(face, BESIDE + (CENTRAL - BESIDE) * central, OUTSIDE)
    region = np.stack([np.where(bare, 0.0, depth), central, np.zeros(len(rest))], axis=1)
    for name, values in ((REST, rest), (REGION, region)):
        attribute = mesh.attributes.get(name)
        if attribute is None:
            attribute = mesh.attributes.new(name, "FLOAT_VECTOR", "POINT")
        attribute.data.foreach_set("vector", values.astype(np.float32).ravel())


def _insert(tree: bpy.types.NodeTree, normal: Any) -> None:
    """Put a bump between the skin's ``normal`` and what it has been so far."""
    frame = tree.nodes.new("NodeFrame")
    frame.name = frame.label = f"{PORES} (made up)"
    bump = _node(tree, frame, "ShaderNodeBump", 0)
    bump.name = PORES
    bump.inputs["Distance"].default_value = MILLIMETRE
    before = normal.links[0].from_socket if normal.is_linked else None
    if before is not None:
        tree.links.new(before, bump.inputs["Normal"])
    tree.links.new(_height(tree, frame), bump.inputs["Height"])
    tree.links.new(bump.outputs["Normal"], normal)


def _remove(tree: bpy.types.NodeTree, bump: bpy.types.Node, normal: Any) -> None:
    before = bump.inputs["Normal"]
    before = before.links[0].from_socket if before.is_linked else None
    frame = bump.parent
    for each in [node for node in tree.nodes if node.parent == frame]:
        tree.nodes.remove(each)
    tree.nodes.remove(frame)
    if before is not None:
        tree.links.new(before, normal)


def _height(tree: bpy.types.NodeTree, frame: bpy.types.Node) -> Any:
    """A socket of the layer's height in mm, at most 0 in pores and about 0 between."""

    def attribute(name: str) -> Any:
        node = _node(tree, frame, "ShaderNodeAttribute", -1500)
        node.attribute_name = name
        return node.outputs["Vector"]

    def calculated(operation: str, x: float, *values: Any) -> Any:
        node = _node(tree, frame, "ShaderNodeMath", x)
        node.operation = operation
        for socket, value in zip(node.inputs, values, strict=False):
            if isinstance(value, float):
                socket.default_value = value
            else:
                tree.links.new(value, socket)
        return node.outputs[0]

    rest, region = attribute(REST), _node(tree, frame, "ShaderNodeSeparateXYZ", -1300)
    tree.links.new(attribute(REGION), region.inputs[0])
    depth, central = region.outputs[0], region.outputs[1]
    layers = []
    for density in (SIDES, NOSE):
        # Cells of a lattice in space, of which the surface cuts as many as have their point
        # within a pore's radius of it: density = diameter / cell^3.
        cells = _node(tree, frame, "ShaderNodeTexVoronoi", -1100)
        cells.inputs["Scale"].default_value = 1e3 / (DIAMETER_MM / density) ** (1 / 3)
        tree.links.new(rest, cells.inputs["Vector"])
        # In cells; the pore is a parabola down to DEPTH_MM.
        radius = DIAMETER_MM / 2 / (DIAMETER_MM / density) ** (1 / 3)
        share = calculated("DIVIDE", -900, cells.outputs["Distance"], radius)
        square = calculated("MULTIPLY", -800, share, share)
        layers.append(calculated("MINIMUM", -700, calculated("SUBTRACT", -750, square, 1.0), 0.0))
    change = calculated("SUBTRACT", -600, layers[1], layers[0])
    pores = calculated("MULTIPLY_ADD", -500, change, central, layers[0])
    noise = _node(tree, frame, "ShaderNodeTexNoise", -1100)
    tree.links.new(rest, noise.inputs["Vector"])
    noise.inputs["Scale"].default_value = 1e3 / WAVELENGTH_MM
    noise.inputs["Detail"].default_value = OCTAVES
    noise.inputs["Roughness"].default_value = FALL
    between = calculated("SUBTRACT", -700, noise.outputs[0], 0.5)
    relief = calculated("MULTIPLY", -500, between, HEIGHT_MM)
    both = calculated("MULTIPLY_ADD", -300, pores, DEPTH_MM, relief)
    return calculated("MULTIPLY", -150, both, depth)


def _node(tree: bpy.types.NodeTree, frame: bpy.types.Node, kind: str, x: float) -> Any:
    node = tree.nodes.new(kind)
    node.parent, node.location = frame, (x, 700)
    node.hide = True
    return node
