"""Where a mesh of the user's has its landmarks, drawn on it as lines, so that a face that was found
in the wrong place is seen before it is fitted.
"""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.face_model import FaceModel

from ..scene.several import home

NAME = "Facestage Landmark Lines"
SCHEME = "ibug68"
COLOR = (0.1, 0.9, 1.0, 1.0)
# First and last of each line, and whether it is closed: jaw, brows, nose, eyes, lips.
_LINES = (
    *((0, 16, False), (17, 21, False), (22, 26, False), (27, 30, False), (31, 35, False)),
    *((36, 41, True), (42, 47, True), (48, 59, True), (60, 67, True)),
)


def show_lines(item: bpy.types.Object, model: FaceModel) -> bpy.types.Object | None:
    """Draw the landmarks of the model that was made of the object's mesh, in place of those drawn
    before; None where it has no table of them.
    """
    remove_lines(item)
    table = model.landmarks.get(SCHEME)
    if table is None or len(table) <= _LINES[-1][1]:
        return None
    mesh = bpy.data.meshes.new(NAME)
    keys = item.data.shape_keys
    data = item.data.vertices if keys is None else keys.reference_key.data
    flat = np.empty(3 * len(data), np.float32)
    data.foreach_get("co", flat)
    points = flat.reshape(-1, 3)[table[:, :3].astype(int)]
    edges = []
    for first, last, closed in _LINES:
        edges += [(index, index + 1) for index in range(first, last)]
        edges += [(last, first)] if closed else []
    mesh.from_pydata(np.einsum("lk,lkc->lc", table[:, 3:], points).tolist(), edges, [])
    lines = bpy.data.objects.new(NAME, mesh)
    lines[NAME] = True
    lines.show_in_front, lines.hide_render, lines.hide_select = True, True, True
    lines.color = COLOR
    home(item).objects.link(lines)
    lines.parent = item
    return lines


def remove_lines(item: bpy.types.Object) -> None:
    """Take the lines on an object away."""
    for lines in [each for each in item.children if each.get(NAME)]:
        mesh = lines.data
        bpy.data.objects.remove(lines)
        bpy.data.meshes.remove(mesh)
