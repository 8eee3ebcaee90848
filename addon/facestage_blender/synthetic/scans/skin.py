"""The material of a scan: skin that light wanders through, with its own color and normals."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy

from facestage.contract.errors import InputError
from facestage.contract.scattering import METRES, RADIUS_MM

from ...pictures.images import load_image

# Of a scan without colors: the middle of light and dark skin, linear.
PLAIN_SKIN = (0.46, 0.30, 0.23)
ROUGHNESS = 0.45
NORMAL_STRENGTH = 0.8


@dataclass(frozen=True)
class SkinMaps:
    """Pictures over the scan's UVs; None: one color, no finer relief."""

    color: Path | None = None  # of the albedo, as displays show it
    normal: Path | None = None  # in the tangent space of the UVs


def skin_material(maps: SkinMaps) -> bpy.types.Material:
    """Random-walk scattering (Principled), in a scene of metres. Raises InputError."""
    material = bpy.data.materials.new("Scanned Skin")
    if material.node_tree is None:  # before Blender 5.0 a new material has no nodes
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    skin = nodes["Principled BSDF"]
    skin.subsurface_method = "RANDOM_WALK_SKIN"
    skin.inputs["Base Color"].default_value = (*PLAIN_SKIN, 1.0)
    skin.inputs["Roughness"].default_value = ROUGHNESS
    skin.inputs["Subsurface Weight"].default_value = 1.0
    skin.inputs["Subsurface Scale"].default_value = METRES
    skin.inputs["Subsurface Radius"].default_value = RADIUS_MM
    if maps.color is not None:
        picture = nodes.new("ShaderNodeTexImage")
        picture.image = _map(maps.color, "--scan-color")
        links.new(picture.outputs["Color"], skin.inputs["Base Color"])
    if maps.normal is not None:
        picture, relief = nodes.new("ShaderNodeTexImage"), nodes.new("ShaderNodeNormalMap")
        picture.image = _map(maps.normal, "--scan-normal")
        picture.image.colorspace_settings.name = "Non-Color"
        relief.inputs["Strength"].default_value = NORMAL_STRENGTH
        links.new(picture.outputs["Color"], relief.inputs["Color"])
        links.new(relief.outputs["Normal"], skin.inputs["Normal"])
    return material


def _map(path: Path, option: str) -> bpy.types.Image:
    try:
        return load_image(path)
    except InputError as error:
        raise InputError(
            f"The picture '{path}' of {option} cannot be read; expected a PNG, JPEG or EXR file."
        ) from error
