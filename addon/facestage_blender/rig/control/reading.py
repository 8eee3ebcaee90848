"""The face that a control rig is for, as plain arrays in the model frame."""

from __future__ import annotations

from collections.abc import Collection

import bpy
import numpy as np

from facestage.contract.face_model import EYES, PARTS, SKIN, TEETH

from ...scene import frames
from ..expressions import expression_keys
from ..face_rig import rig_axes
from ..own_marks import slot_parts
from ..own_record import OwnMesh
from .places import Face


def expression_names(rig: bpy.types.Object) -> list[str]:
    """The rig's expression sliders that handles may add to: those that nothing else drives."""
    shapes = rig.data.shape_keys
    data = None if shapes is None else shapes.animation_data
    driven = set() if data is None else {driver.data_path for driver in data.drivers}
    return [
        key.name
        for keys in expression_keys(rig).values()
        for key in keys
        if key.name in shapes or key.path_from_id("value") not in driven
    ]


def full_values(rig: bpy.types.Object) -> dict[str, float]:
    """The value of each expression slider that counts as all of it."""
    own = OwnMesh.of(rig)
    values = {key.name: 1.0 for keys in expression_keys(rig).values() for key in keys}
    if own is not None:
        values |= {key: factor for key, factor in own.expression.values() if factor > 0}
    return values


def mesh_to_model(rig: bpy.types.Object) -> np.ndarray:
    """(4, 4) from the mesh's own coordinates to the model frame, metres."""
    return frames.to_contract(rig_axes(rig))


def read_face(rig: bpy.types.Object, sliders: Collection[str]) -> Face:
    """The rig's face at rest, as its identity sliders show it, and the motion of ``sliders``."""
    matrix, full = mesh_to_model(rig), full_values(rig)
    blocks = rig.data.shape_keys.key_blocks
    basis = _points(blocks[0])
    points = basis.copy()
    moves = {}
    for key in blocks[1:]:
        moved, shown = key.name in sliders, key.name not in full and not key.mute and key.value
        if not moved and not shown:
            continue
        alone = key.relative_key == blocks[0]
        offset = _points(key) - (basis if alone else _points(key.relative_key))
        if moved:
            moves[key.name] = offset @ (full[key.name] * matrix[:3, :3].T)
        else:
            points += key.value * offset
    part = _parts(rig)
    return Face(
        points=points @ matrix[:3, :3].T + matrix[:3, 3],
        moves=moves,
        skin=part[SKIN] | part[len(PARTS)],
        eyes=part[EYES],
        teeth=part[TEETH],
    )


def _points(key: bpy.types.ShapeKey) -> np.ndarray:
    """(n, 3) float64 coordinates."""
    data = getattr(key, "points", key.data)  # read at once from Blender 4.1 on
    flat = np.empty(3 * len(data), np.float32)
    data.foreach_get("co", flat)
    return flat.reshape(-1, 3).astype(np.float64)


def _parts(rig: bpy.types.Object) -> np.ndarray:
    """(parts + 1, n) bool: the vertices of each part by the materials, the last row what no
    material says.
    """
    mesh = rig.data
    index, total = np.empty((2, len(mesh.polygons)), np.int32)
    mesh.polygons.foreach_get("material_index", index)
    mesh.polygons.foreach_get("loop_total", total)
    vertex = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertex)
    slots = np.minimum(np.array([*slot_parts(rig), len(PARTS)]), len(PARTS))
    part = np.repeat(slots[np.minimum(index, len(slots) - 1)], total)
    found = np.zeros((len(PARTS) + 1, len(mesh.vertices)), bool)
    found[part, vertex] = True
    return found
