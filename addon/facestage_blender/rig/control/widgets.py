"""What handles look like: wires that no render shows and no collection holds."""

from __future__ import annotations

import math

import bpy

PREFIX = "WGT-facestage_"  # as Rigify calls its own
_TURN = [math.tau * each / 32 for each in range(32)]

# Points of closed lines in a bone's own axes.
SHAPES = {
    "ring": [(math.cos(a), math.sin(a), 0.0) for a in _TURN],  # faces Z
    "hoop": [(math.cos(a), 0.0, math.sin(a)) for a in _TURN],  # around Y
    "diamond": [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)],
    "frame": [(4.5, 1.0, 0.0), (-4.5, 1.0, 0.0), (-4.5, -1.0, 0.0), (4.5, -1.0, 0.0)],
    "chin": [
        *((math.cos(a), 0.6 * math.sin(a), 0.0) for a in _TURN[:17]),
        *((0.8 * math.cos(a), 0.45 * math.sin(a), 0.0) for a in reversed(_TURN[:17])),
    ],
}


def widget(name: str) -> bpy.types.Object:
    """The object of a shape, made when missing."""
    found: bpy.types.Object | None = bpy.data.objects.get(PREFIX + name)
    if found is not None and found.type == "MESH" and found.library is None:
        return found
    points = SHAPES[name]
    mesh = bpy.data.meshes.new(PREFIX + name)
    around = [(each, (each + 1) % len(points)) for each in range(len(points))]
    mesh.from_pydata(points, around, [])
    return bpy.data.objects.new(PREFIX + name, mesh)


def remove_unused() -> None:
    """Take away the shapes that no bone shows any more."""
    for name in SHAPES:
        found = bpy.data.objects.get(PREFIX + name)
        if found is not None and not found.users:
            mesh = found.data
            bpy.data.objects.remove(found)
            if not mesh.users:
                bpy.data.meshes.remove(mesh)
