"""A face's eyes as other programs read them: their own picture, over their own UVs."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import bpy
import numpy as np

from facestage.contract.texture_maps import ALBEDO, EYE_MAP, TEXTURE_MAPS, uv_box

from ..pictures.images import image_pixels
from ..pictures.render import save_png, srgb
from .eye_material import MATERIAL, material_uvs, of_slot, render_uvs
from .plain_skin import INPUTS, plain_skin, smaller

GLOSS = ("specular", "roughness")
Box = tuple[float, float, float, float]  # of the UV square: left, bottom, right, top


def write_eyes(rig: bpy.types.Object, folder: Path, side: int | None) -> dict[str, Path]:
    """Write the eyes' picture to ``folder``, sRGB-encoded; the file by the map's name, or nothing
    where the rig has none. ``side``: the most pixels along a side.
    """
    image = rig.facestage_face.eyes_image
    if image is None:
        return {}
    path = folder / f"{EYE_MAP.name}.png"
    save_png(path, srgb(smaller(image_pixels(image)[..., :3], side)))
    return {EYE_MAP.name: path}


def shows_eyes(material: bpy.types.Material, pictures: Mapping[str, Path]) -> bool:
    """Whether a material of Facestage's is that of eyes with a picture of their own."""
    return material.name.startswith(MATERIAL) and EYE_MAP.name in pictures


def plain_eyes(
    name: str, rig: bpy.types.Object, index: int, pictures: Mapping[str, Path], uv_map: str
) -> bpy.types.Material:
    """A new material of the eyes' picture, for the rig's material slot ``index``. It wants UVs that
    :func:`spread_uvs` has spread; so gloss is one value, the median of its map's part.
    """
    box = uv_box(material_uvs(rig.data, index))
    material = plain_skin(name, rig, {ALBEDO.name: pictures[EYE_MAP.name]}, uv_map)
    surface = next(
        node for node in material.node_tree.nodes if node.bl_idname == "ShaderNodeBsdfPrincipled"
    )
    for each in TEXTURE_MAPS:
        image = getattr(rig.facestage_face, f"{each.name}_image")
        if image is not None and not each.colored and each.name in GLOSS:
            socket, factor = INPUTS[each.name]
            surface.inputs[socket].default_value = factor * _median(image_pixels(image), box)
    return material


def spread_uvs(mesh: bpy.types.Mesh, index: int) -> None:
    """Let the polygons of a material slot fill the UV square, in the UV map that is rendered."""
    layer = render_uvs(mesh)
    if layer is None:
        return
    uvs = np.empty(2 * len(mesh.loops), np.float32)
    layer.uv.foreach_get("vector", uvs)
    points, chosen = uvs.reshape(-1, 2), of_slot(mesh, index)
    left, bottom, right, top = uv_box(points[chosen])
    size = np.maximum([right - left, top - bottom], 1e-6)
    points[chosen] = (points[chosen] - [left, bottom]) / size
    # Not layer.uv: until Blender 5.1 that writes into the mesh that this one was copied from, too.
    mesh.attributes[layer.name].data.foreach_set("vector", uvs)


def _median(pixels: np.ndarray, box: Box) -> float:
    """The median of the first channel of pixels (h, w, c), row 0 at the top, in a box."""
    height, width = pixels.shape[:2]
    left, bottom, right, top = box
    rows = slice(int((1 - top) * height), int(np.ceil((1 - bottom) * height)))
    columns = slice(int(left * width), int(np.ceil(right * width)))
    return float(np.median(pixels[rows, columns, 0]))
