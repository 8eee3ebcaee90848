"""A user's own shape-keyed mesh as a face model: what it lacks is carried over from the default
model.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, OTHER, SKIN, FaceModel, split_quads
from facestage.contract.rig_file import UNKNOWN_PART, RigFile
from facestage.models.anatomy.regions import IRIS, IRIS_RADIUS, PART_ALBEDO, PUPIL, PUPIL_RADIUS
from facestage.models.anatomy.skin import albedo_basis
from facestage.models.correspondence.borrowed_modes import borrowed_modes
from facestage.models.correspondence.coarse_alignment import axis_rotations
from facestage.models.correspondence.registration import Registration, register
from facestage.models.correspondence.transfer import (
    landmark_tables,
    parts_of_pieces,
    region_vertices,
)
from facestage.models.mesh.similarity import Similarity
from facestage.models.mesh.surface import pieces

# What a modeler's unit is in metres; the first that makes the face a plausible size is taken.
_UNITS = (1.0, 0.01, 0.001, 0.1, 0.0254, 0.3048)
_PLAUSIBLE = 1.35  # times larger or smaller than the default face
_UPRIGHT = 25.0  # degrees: a face less turned than this is taken for one along the axes
_MOVED = 0.05  # of the largest offset
_EYEBALL = (0.015, 0.040)  # metres: the extents of an eyeball


def load_rig(path: Path, default_head: Callable[[], FaceModel]) -> FaceModel:
    """The face model of a file that the add-on wrote (RigFile), in metres, upright, looking along
    +Z.

    Its vertices keep their order. Landmarks that the user has marked are exact, the others, the
    regions and, when asked for, identity modes come from the default model by registration. Raises
    InputError for a wrong file, or when no face is found on the mesh.
    """
    rig = RigFile.load(path)
    scale = np.array(rig.scale)
    vertices = rig.vertices * scale
    triangles = split_quads(rig.polygons)
    part = np.repeat(rig.polygon_part, 1 + (rig.polygons[:, 3] >= 0))
    marked = {index: place * scale for index, place in rig.known_points().items()}
    default = default_head()
    skin = triangles[(part == SKIN) | (part == UNKNOWN_PART)]
    if len(skin) < 100:
        raise InputError(
            f"The mesh '{rig.name}' has {len(skin)} triangles of skin; mark the face's "
            "material as skin."
        )
    fit = register(default, vertices, skin, marked, _moved(rig))
    polygon_part = _parts(rig, fit, vertices, triangles)
    part = np.repeat(polygon_part, 1 + (rig.polygons[:, 3] >= 0))
    landmarks = landmark_tables(fit, vertices, triangles[part != OTHER], marked)
    on_skin = np.zeros(len(vertices), bool)
    on_skin[triangles[part == SKIN]] = True
    regions = region_vertices(fit, vertices, triangles, on_skin)
    if not len(regions["narrow_face"]):
        raise InputError(
            f"The mesh '{rig.name}' has no skin where the face is; check its materials' parts."
        )
    to_model = _upright(fit.similarity, vertices[regions["narrow_face"]])
    linear = to_model.scale * to_model.rotation * scale
    identity_names, identity = rig.identity_names, rig.identity_offsets @ linear.T
    if not identity_names and rig.borrow_identity:
        identity_names = default.identity_names
        identity = (
            to_model.scale * borrowed_modes(fit, vertices, triangles, part) @ to_model.rotation.T
        )
    placed = to_model.apply(vertices)
    mean, basis = albedo_basis(placed, triangles[part == SKIN], on_skin)
    for label, color in PART_ALBEDO.items():
        used = np.unique(triangles[part == label])
        mean[used[~on_skin[used]]] = color
    _paint_irises(
        mean, placed, pieces(vertices, triangles), np.unique(triangles[part == EYES]), on_skin
    )
    return FaceModel(
        name=rig.name,
        license=rig.license,
        source=str(path),
        vertices=placed.astype(np.float32),
        polygons=rig.polygons,
        polygon_uvs=rig.polygon_uvs,
        polygon_part=polygon_part,
        uvs=rig.uvs,
        identity_names=identity_names,
        identity_basis=identity.astype(np.float32),
        expression_names=rig.expression_names,
        expression_basis=(rig.expression_offsets @ linear.T).astype(np.float32),
        albedo_mean=mean,
        albedo_basis=basis,
        landmarks=landmarks,
        regions=regions,
    )


def _moved(rig: RigFile) -> np.ndarray | None:
    """(n,) bool, the vertices that expressions move: where the face of a whole body is.

    None when nothing says.
    """
    moved = np.zeros(len(rig.vertices), int)
    for offsets in rig.expression_offsets:
        length = np.linalg.norm(offsets, axis=1)
        moved += length > _MOVED * max(float(length.max()), 1e-30)
    return moved > min(1, len(rig.expression_offsets) - 1) if moved.any() else None


def _parts(
    rig: RigFile, fit: Registration, vertices: np.ndarray, triangles: np.ndarray
) -> np.ndarray:
    """(p,) uint8 part of each polygon; a loose piece of unknown kind is what the default model has
    in its place.
    """
    part = rig.polygon_part.copy()
    unknown = part == UNKNOWN_PART
    if unknown.any():
        piece = pieces(vertices, triangles)
        guessed = parts_of_pieces(fit, vertices, triangles, piece)
        part[unknown] = guessed[piece[rig.polygons[unknown, 0]]]
    return part


def _paint_irises(
    mean: np.ndarray, vertices: np.ndarray, piece: np.ndarray, eyes: np.ndarray, on_skin: np.ndarray
) -> None:
    """Color iris and pupil on the front of each eyeball; vertices (n, 3) in the model frame."""
    for label in np.unique(piece[eyes]):
        ball = eyes[(piece[eyes] == label) & ~on_skin[eyes]]
        if not len(ball):
            continue
        low, high = vertices[ball].min(axis=0), vertices[ball].max(axis=0)
        if not _EYEBALL[0] < (high - low).min() <= (high - low).max() < _EYEBALL[1]:
            continue
        centre = 0.5 * (low + high)
        radius = np.hypot(*(vertices[ball, :2] - centre[:2]).T)
        for size, color in ((IRIS_RADIUS, IRIS), (PUPIL_RADIUS, PUPIL)):
            mean[ball[(radius < size) & (vertices[ball, 2] > centre[2])]] = color


def _upright(similarity: Similarity, narrow_face: np.ndarray) -> Similarity:
    """From the mesh's coordinates to the model frame, keeping the mesh's own size and axes where
    they are plausible.
    """
    rotation = similarity.rotation
    axes = axis_rotations()
    nearest = max(axes, key=lambda axis: float(np.trace(axis.T @ rotation)))
    angle = np.degrees(np.arccos(np.clip((np.trace(nearest.T @ rotation) - 1) / 2, -1, 1)))
    if angle < _UPRIGHT:
        rotation = nearest
    scale = next(
        (u for u in _UNITS if 1 / _PLAUSIBLE < u * similarity.scale < _PLAUSIBLE),
        1 / similarity.scale,
    )
    return Similarity(scale, rotation.T, -scale * rotation.T @ narrow_face.mean(axis=0))
