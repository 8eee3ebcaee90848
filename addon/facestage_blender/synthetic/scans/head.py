"""A head from an OBJ file, read by Blender's own importer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file

from ...pictures.render import quiet

UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0}  # in millimetres
AXES = {
    f"{sign}{name}": (1 if sign == "+" else -1) * np.eye(3)[index]
    for index, name in enumerate("XYZ")
    for sign in "+-"
}
# Of a scan's whole extent in mm: a face alone has 150, a bust with shoulders 600.
SIZE_MIN, SIZE_MAX = 80.0, 2000.0


@dataclass(frozen=True)
class ScannedHead:
    """A mesh of the .blend, and its vertices in the head's own frame, in millimetres."""

    mesh: bpy.types.Mesh
    vertices: np.ndarray  # (n, 3)
    complete: bool  # every vertex of the file is one of the mesh, so their numbers are the same

    @property
    def triangles(self) -> np.ndarray:
        """(t, 3) vertices of the polygons, cut into triangles."""
        self.mesh.calc_loop_triangles()
        found = np.empty(3 * len(self.mesh.loop_triangles), np.int32)
        self.mesh.loop_triangles.foreach_get("vertices", found)
        return found.reshape(-1, 3)

    @property
    def has_uvs(self) -> bool:
        """Whether the mesh can carry a texture."""
        return bool(self.mesh.uv_layers)


def read_head(path: Path, units: str, facing: str, up: str) -> ScannedHead:
    """The head in an OBJ: quads, polygons of any number of corners, with or without UVs and
    normals; all objects of the file are one.

    ``facing`` and ``up`` name the file's axes that the head looks along and that its crown points
    to. Raises InputError.
    """
    rotation = axes(facing, up)
    if not is_file(path):
        raise InputError(f"The scan '{path}' does not exist; expected an OBJ file.")
    before = set(bpy.data.objects)
    try:
        with quiet():
            # Blender's own axes: nothing is turned.
            bpy.ops.wm.obj_import(
                filepath=str(path.resolve()),
                forward_axis="Y",
                up_axis="Z",
                use_split_objects=False,
                use_split_groups=False,
            )
    except RuntimeError as error:
        raise InputError(f"The scan '{path}' cannot be read; expected an OBJ file.") from error
    meshes = [item.data for item in set(bpy.data.objects) - before if item.type == "MESH"]
    for item in set(bpy.data.objects) - before:
        bpy.data.objects.remove(item)
    if not meshes or not len(meshes[0].polygons):
        raise InputError(
            f"The scan '{path}' has no polygon that could be read; expected an OBJ with vertices "
            "(v) and faces (f)."
        )
    mesh = meshes[0]
    stored = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", stored)
    vertices = UNITS[units] * stored.reshape(-1, 3).astype(np.float64) @ rotation.T
    size = float(np.ptp(vertices, axis=0).max())
    if not SIZE_MIN <= size <= SIZE_MAX:
        raise InputError(
            f"The scan '{path}' is {size:.3g} mm large if its unit is {units}, expected "
            f"{SIZE_MIN:g} to {SIZE_MAX:g} mm; give --scan-units mm, cm or m."
        )
    head = ScannedHead(mesh, vertices, len(vertices) == _vertex_lines(path))
    _turn_outwards(head)
    return head


def axes(facing: str, up: str) -> np.ndarray:
    """(3, 3) rotation from the file's axes to the head's.

    Raises InputError for names of one line.
    """
    ahead, crown = AXES[facing], AXES[up]
    if ahead @ crown != 0:
        raise InputError(
            f"The head cannot look along {facing} and have its crown along {up}; give two axes "
            "that stand upright on each other."
        )
    return np.stack([np.cross(crown, ahead), crown, ahead])


def _turn_outwards(head: ScannedHead) -> None:
    """Smooth normals of the geometry alone, and outwards: light must enter the skin from
    outside.
    """
    if head.mesh.has_custom_normals:
        head.mesh.normals_split_custom_set([(0.0, 0.0, 0.0)] * len(head.mesh.loops))
    head.mesh.shade_smooth()
    a, b, c = (head.vertices[head.triangles[:, corner]] for corner in range(3))
    middle = (a + b + c) / 3 - head.vertices.mean(axis=0)
    # The volume within, by the divergence theorem: negative for a surface inside out.
    if float((np.cross(b - a, c - a) * middle).sum()) < 0:
        head.mesh.flip_normals()


def _vertex_lines(path: Path) -> int:
    """How many vertices an OBJ has, also those that no face uses, which the importer drops."""
    with path.open("rb") as stream:
        return sum(line.lstrip().startswith((b"v ", b"v\t")) for line in stream)
