"""UVs of a user's mesh that can carry one texture: its own, or a map of their own beside them."""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.errors import InputError

from .uv_atlas import atlas, overlaps

LAYER = "Facestage"
_MAX_LAYERS = 8


def face_uvs(item: bpy.types.Object) -> tuple[str, np.ndarray]:
    """Name of the UV map to use, and its (l, 2) float64 corners in 0..1.

    The mesh's own map serves when it is one square without overlaps. Several squares (materials,
    UDIM tiles) are packed into a map named "Facestage"; without UVs, or with halves on top of each
    other, that map is unwrapped anew. The mesh's own maps and its selection stay as they are.
    """
    mesh = item.data
    own = [layer for layer in mesh.uv_layers if layer.name != LAYER]
    chosen = next((layer for layer in own if layer.active_render), own[0] if own else None)
    if chosen is None:
        return LAYER, _unwrapped(item)
    uvs = _corners(chosen)
    everything = np.ones(len(mesh.polygons), bool)
    one_square = bool(np.isfinite(uvs).all() and uvs.min() >= -1e-4 and uvs.max() <= 1 + 1e-4)
    if one_square and not overlaps(_triangles(mesh, uvs, everything)):
        return chosen.name, np.clip(uvs, 0.0, 1.0)
    polygon = _corner_polygons(mesh)
    material = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("material_index", material)
    area = np.empty(len(mesh.polygons), np.float32)
    mesh.polygons.foreach_get("area", area)
    counts = np.maximum(np.bincount(polygon, minlength=len(material)), 1)
    middle = np.stack(
        [np.bincount(polygon, uvs[:, k], len(material)) / counts for k in range(2)], axis=1
    )
    square = np.floor(middle)
    _, tile = np.unique(np.column_stack([material, square]), axis=0, return_inverse=True)
    tile = tile.ravel()
    inside = uvs - square[polygon]
    largest = np.bincount(tile, area).argmax()
    if not np.isfinite(uvs).all() or overlaps(_triangles(mesh, inside, tile == largest)):
        return LAYER, _unwrapped(item)
    packed = atlas(tile, area.astype(np.float64), np.clip(inside, 0.0, 1.0), polygon)
    layer = _layer(mesh)
    layer.uv.foreach_set("vector", packed.astype(np.float32).ravel())
    return LAYER, packed


def _triangles(mesh: bpy.types.Mesh, uvs: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(t, 3, 2) UV triangles of the wanted faces."""
    mesh.calc_loop_triangles()
    loops = np.empty(3 * len(mesh.loop_triangles), np.int32)
    owner = np.empty(len(mesh.loop_triangles), np.int32)
    mesh.loop_triangles.foreach_get("loops", loops)
    mesh.loop_triangles.foreach_get("polygon_index", owner)
    return uvs[loops.reshape(-1, 3)[wanted[owner]]]


def _layer(mesh: bpy.types.Mesh) -> bpy.types.MeshUVLoopLayer:
    """The map named "Facestage", made when missing; the active maps stay active."""
    layer = mesh.uv_layers.get(LAYER)
    if layer is None:
        if len(mesh.uv_layers) >= _MAX_LAYERS:
            raise InputError(
                f"The mesh '{mesh.name}' has {_MAX_LAYERS} UV maps, the most there can be; "
                "remove one."
            )
        active = mesh.uv_layers.active_index
        layer = mesh.uv_layers.new(name=LAYER, do_init=False)
        mesh.uv_layers.active_index = max(active, 0)
    return mesh.uv_layers[LAYER]


def _unwrapped(item: bpy.types.Object) -> np.ndarray:
    """(l, 2) corners of the map named "Facestage", unwrapped by Blender; the selection is
    restored.
    """
    mesh = item.data
    _layer(mesh)
    active = mesh.uv_layers.active_index
    mesh.uv_layers.active_index = mesh.uv_layers.find(LAYER)
    elements = (mesh.vertices, mesh.edges, mesh.polygons)
    kept = []
    for element in elements:
        state = np.empty((2, len(element)), bool)
        element.foreach_get("select", state[0])
        element.foreach_get("hide", state[1])
        element.foreach_set("hide", np.zeros(len(element), bool))
        kept.append(state)
    layer = bpy.context.view_layer
    for other in list(layer.objects.selected):
        other.select_set(False)
    item.hide_set(False)
    item.select_set(True)
    layer.objects.active = item
    try:
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT")
        bpy.ops.uv.smart_project(island_margin=0.004)
    except RuntimeError as error:
        raise InputError(
            f"The mesh '{item.name}' cannot be unwrapped ({error}); give it a UV map."
        ) from error
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")
        for element, state in zip((mesh.vertices, mesh.edges, mesh.polygons), kept, strict=True):
            element.foreach_set("hide", state[1])
            element.foreach_set("select", state[0])
        mesh.uv_layers.active_index = active
    return np.clip(_corners(mesh.uv_layers[LAYER]), 0.0, 1.0)


def _corners(layer: bpy.types.MeshUVLoopLayer) -> np.ndarray:
    flat = np.empty(2 * len(layer.uv), np.float32)
    layer.uv.foreach_get("vector", flat)
    return flat.reshape(-1, 2).astype(np.float64)


def _corner_polygons(mesh: bpy.types.Mesh) -> np.ndarray:
    total = np.empty(len(mesh.polygons), np.int32)
    mesh.polygons.foreach_get("loop_total", total)
    return np.repeat(np.arange(len(total)), total)
