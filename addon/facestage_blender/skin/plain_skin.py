"""A face's skin as other programs read it: one Principled BSDF and ordinary 8-bit pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np

from facestage.contract.brdf import SPECULAR_MAX
from facestage.contract.texture_maps import NORMAL, TEXTURE_MAPS, TextureMap

from ..pictures.images import DATA, image_pixels
from ..pictures.render import save_png, srgb
from .material import GROUP

# The input of the Principled BSDF, and what a map's value is multiplied by there: a specular level
# of 0.5 is a dielectric of index 1.5, which a c_spec of 1 is. The BSDF takes what the surface
# reflects from the light that enters by itself, as K_DIFFUSE does on average: the albedo stays.
INPUTS: Mapping[str, tuple[str, float]] = {
    "albedo": ("Base Color", 1.0),
    "specular": ("Specular IOR Level", 1.0 / SPECULAR_MAX),
    "roughness": ("Roughness", 1.0),
    "normal": ("Normal", 1.0),
}


def write_textures(rig: bpy.types.Object, folder: Path, side: int | None) -> dict[str, Path]:
    """Write the rig's maps to ``folder`` as PNG, the albedo sRGB-encoded, the others linear; the
    files by the maps' names.

    ``side``: the most pixels along a side; None: as many as there are.
    """
    written = {}
    for each in TEXTURE_MAPS:
        image = getattr(rig.facestage_face, f"{each.name}_image")
        if image is None or each.name not in INPUTS:
            continue
        pixels = smaller(image_pixels(image)[..., :3], side) * INPUTS[each.name][1]
        written[each.name] = folder / f"{each.name}.png"
        save_png(written[each.name], srgb(pixels) if each.colored else np.clip(pixels, 0, 1))
    return written


def plain_skin(
    name: str, rig: bpy.types.Object, pictures: Mapping[str, Path], uv_map: str
) -> bpy.types.Material:
    """A new material of the rig's maps; what has no picture has the rig's one value."""
    material = bpy.data.materials.new(name)
    if material.node_tree is None:  # before Blender 5.0 a new material has no nodes
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    surface, output = (nodes.new("ShaderNodeBsdfPrincipled"), nodes.new("ShaderNodeOutputMaterial"))
    links.new(surface.outputs["BSDF"], output.inputs["Surface"])
    for each in (each for each in TEXTURE_MAPS if each.name in INPUTS):
        socket, factor = INPUTS[each.name]
        if each.name in pictures:
            node = nodes.new("ShaderNodeTexImage")
            node.image = _picture(pictures[each.name], each)
            node.extension = "EXTEND"
            color = node.outputs["Color"]
            if each is NORMAL:
                bent = nodes.new("ShaderNodeNormalMap")
                bent.uv_map = uv_map
                links.new(color, bent.inputs["Color"])
                color = bent.outputs["Normal"]
            links.new(color, surface.inputs[socket])
            if uv_map:
                uvs = nodes.new("ShaderNodeUVMap")
                uvs.uv_map = uv_map
                links.new(uvs.outputs["UV"], node.inputs["Vector"])
        elif each.plain is not None:
            surface.inputs[socket].default_value = factor * getattr(rig.facestage_face, each.plain)
    return material


def is_facestage_skin(material: bpy.types.Material | None) -> bool:
    """Whether a material shows the fitted textures."""
    return (
        material is not None
        and material.node_tree is not None
        and GROUP in material.node_tree.nodes
    )


def _picture(path: Path, each: TextureMap) -> bpy.types.Image:
    """The picture in a file, loaded once."""
    image = bpy.data.images.load(str(path), check_existing=True)
    image.colorspace_settings.name = "sRGB" if each.colored else DATA
    return image


def smaller(pixels: np.ndarray, side: int | None) -> np.ndarray:
    """Means of squares of pixels (h, w, 3), so that no side has more than ``side``."""
    height, width = pixels.shape[:2]
    step = 1 if side is None else -(-max(height, width) // side)
    if step == 1:
        return pixels
    rows, columns = height // step, width // step
    cut = pixels[: rows * step, : columns * step]
    return cut.reshape(rows, step, columns, step, 3).mean(axis=(1, 3))
