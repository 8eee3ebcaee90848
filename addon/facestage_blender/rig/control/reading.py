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


def rest_points(rig: bpy.types.Object) -> np.ndarray:
    """(n, 3) float64: the rig's face at rest, as its identity sliders show it, in the mesh's own
    coordinates.
    """
    full, blocks = full_values(rig), rig.data.shape_keys.key_blocks
    points = _points(blocks[0]).astype(np.float64)
    for key in blocks[1:]:
        if key.name not in full and not key.mute and key.value:
            points += key.value * (_points(key) - _points(key.relative_key))
    return points


def read_face(rig: bpy.types.Object, rest: np.ndarray, sliders: Collection[str]) -> Face:
    """The rig's face, at rest as ``rest`` (n, 3), and the motion of ``sliders``, in the model
    frame.
    """
    matrix, full = mesh_to_model(rig), full_values(rig)
    blocks = rig.data.shape_keys.key_blocks
    basis, moves = _points(blocks[0]), {}
    for name in sliders:
        key = blocks[name]
        alone = key.relative_key == blocks[0]
        offset = _points(key) - (basis if alone else _points(key.relative_key))
        moves[name] = offset @ (full[name] * matrix[:3, :3].T).astype(np.float32)
    part = _parts(rig)
    return Face(
        points=rest @ matrix[:3, :3].T + matrix[:3, 3],
        moves=moves,
        skin=part[SKIN] | part[len(PARTS)],
        eyes=part[EYES],
        teeth=part[TEETH],
    )


def _points(key: bpy.types.ShapeKey) -> np.ndarray:
    """(n, 3) float32 coordinates."""
    data = getattr(key, "points", key.data)  # read at once from Blender 4.1 on
    flat = np.empty(3 * len(data), np.float32)
    data.foreach_get("co", flat)
    return flat.reshape(-1, 3)


def _parts(rig: bpy.types.Object) -> np.ndarray:
    """(parts + 1, n) bool: the vertices of each part by the materials, the last row what no
    material says.
    """
    mesh = rig.data
    index, total = np.empty((2, len(mesh.polygons)), np.int32)
    mesh.polygons.foreach_get("material_index", index)
    mesh.polygons.foreach_get("loop_total", total)
    vertex = np.empty(len(mesh.loops), np.int32)
    mesh.attributes[".corner_vert"].data.foreach_get("value", vertex)  # at once, unlike loops
    slots = np.minimum(np.array([*slot_parts(rig), len(PARTS)]), len(PARTS))
    part = np.repeat(slots[np.minimum(index, len(slots) - 1)], total)
    found = np.zeros((len(PARTS) + 1, len(mesh.vertices)), bool)
    found[part, vertex] = True
    return found
