"""A mesh of the user's as a face rig: read with its shape keys, and written back to without
changing what is theirs.

What Facestage must know of it later (which slider each shape of the model is, and where the model's
frame lies in the mesh) is kept on the object as JSON: :class:`OwnMesh`.
"""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.rig_file import UNKNOWN_PART, RigFile

from .own_marks import read_marks, slot_parts
from .own_record import OwnMesh
from .own_sliders import read_shapes
from .own_uvs import face_uvs


def read_mesh(item: bpy.types.Object | None) -> tuple[RigFile, OwnMesh, list[str]]:
    """The object's mesh for the backend, its sliders, and sentences on what was left out.

    Must run in object mode. A UV map named "Facestage" is added where the mesh's own cannot carry
    one texture. Raises InputError when the object is no mesh that can be a face.
    """
    if item is None or item.type != "MESH":
        raise InputError("No mesh is active; select the mesh of a face and make it active.")
    mesh = item.data
    if len(mesh.vertices) < 100 or len(mesh.polygons) < 100:
        raise InputError(
            f"The mesh '{item.name}' has {len(mesh.vertices)} vertices and {len(mesh.polygons)} "
            "faces; a face needs at least 100 of each: make the mesh of a face active."
        )
    vertices, identity, expression, own, notes = read_shapes(item)
    layer, corner_uvs = face_uvs(item)
    own.uv_layer = layer
    polygons, corners, source = _quads_and_triangles(mesh)
    uvs, first = np.unique(np.round(corner_uvs, 6), axis=0, return_inverse=True)
    polygon_uvs = np.where(corners >= 0, first.ravel()[np.maximum(corners, 0)], -1).astype(np.int32)
    scale = item.matrix_world.to_scale()
    if min(abs(value) for value in scale) < 1e-9:
        raise InputError(f"The object '{item.name}' is scaled to nothing; reset its scale (Alt S).")
    rig = RigFile(
        name=item.name,
        license="yours",
        vertices=vertices,
        scale=(scale.x, scale.y, scale.z),
        polygons=polygons,
        polygon_uvs=polygon_uvs,
        polygon_part=_parts(item)[source],
        uvs=uvs.astype(np.float32),
        expression_names=tuple(own.expression),
        expression_offsets=expression,
        identity_names=tuple(own.identity),
        identity_offsets=identity,
        borrow_identity=item.facestage_face.fit_shape,
        marks=read_marks(item),
    )
    return rig, own, notes


def model_frame(rig: RigFile, model: FaceModel) -> np.ndarray:
    """(4, 4) from the mesh's own coordinates to the model frame, from the same vertices in both."""
    if len(model.vertices) != len(rig.vertices):
        raise InputError(
            f"The backend's model has {len(model.vertices)} vertices, the mesh "
            f"{len(rig.vertices)}; press Use My Mesh again."
        )
    middle = rig.vertices.mean(axis=0)
    size = max(float(np.ptp(rig.vertices)), 1e-12)
    columns = np.concatenate(
        [(rig.vertices - middle) / size, np.ones((len(rig.vertices), 1))], axis=1
    )
    solution = np.linalg.lstsq(columns, model.vertices.astype(np.float64), rcond=None)[0]
    matrix = np.eye(4)
    matrix[:3, :3] = solution[:3].T / size
    matrix[:3, 3] = solution[3] - matrix[:3, :3] @ middle
    return matrix


def _quads_and_triangles(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices and corners (p, 4) int32 of quads and triangles, and the face (p,) each comes from;
    n-gons are split.
    """
    start, total = np.empty((2, len(mesh.polygons)), np.int32)
    mesh.polygons.foreach_get("loop_start", start)
    mesh.polygons.foreach_get("loop_total", total)
    vertex = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertex)
    small = np.flatnonzero(total <= 4)
    corners = start[small, None] + np.arange(4, dtype=np.int32)
    corners[total[small] == 3, 3] = -1
    source = small
    if len(small) < len(total):
        mesh.calc_loop_triangles()
        loops = np.empty(3 * len(mesh.loop_triangles), np.int32)
        owner = np.empty(len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("loops", loops)
        mesh.loop_triangles.foreach_get("polygon_index", owner)
        large = total[owner] > 4
        split = np.full((int(large.sum()), 4), -1, np.int32)
        split[:, :3] = loops.reshape(-1, 3)[large]
        corners, source = np.concatenate([corners, split]), np.concatenate([small, owner[large]])
    polygons = np.where(corners >= 0, vertex[np.maximum(corners, 0)], -1).astype(np.int32)
    return polygons, corners, source


def _parts(item: bpy.types.Object) -> np.ndarray:
    """(faces,) uint8 part of each face by its material."""
    index = np.empty(len(item.data.polygons), np.int32)
    item.data.polygons.foreach_get("material_index", index)
    table = np.array(slot_parts(item) or [UNKNOWN_PART], np.uint8)
    return table[np.minimum(index, len(table) - 1)]
