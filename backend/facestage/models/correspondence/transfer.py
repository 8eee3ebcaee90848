"""What the default model knows of its face, carried over to another mesh that it was registered
to.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.face_model import EYES, OTHER, SKIN
from facestage.models.correspondence.registration import SCHEME, Registration
from facestage.models.mesh.surface import Surface, normals_and_areas, vertex_normals

_COSINE = 0.2
_REGIONS = ("narrow_face", "face")
_REGION_REACH = 8e-3  # metres on the default face
_PIECE_REACH = 15e-3
# of the main piece's area: a smaller loose piece over the skin is a lash, a brow or a tear line
_SKIN_SHARE = 0.05


def landmark_tables(
    fit: Registration,
    vertices: np.ndarray,
    triangles: np.ndarray,
    known_points: Mapping[int, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """The default model's landmark tables on the mesh (vertices, triangles) that ``fit`` was made
    for.

    The mesh may have more loose parts than the fit looked at, such as eyeballs.
    """
    surface = Surface(vertices, triangles)
    normals = vertex_normals(fit.vertices, fit.model.triangles)
    sign = 1.0 if fit.right_side_out else -1.0
    tables = {}
    for scheme, table in fit.model.landmarks.items():
        corners, weights = table[:, :3].astype(np.int64), table[:, 3:].astype(np.float64)
        points = np.einsum("mk,mkc->mc", weights, fit.vertices[corners])
        facing = sign * np.einsum("mk,mkc->mc", weights, normals[corners])
        if scheme == SCHEME:
            for index, place in (known_points or {}).items():
                points[index] = place
        near, any_side = surface.nearest(points, facing, _COSINE), surface.nearest(points)
        usable = np.isfinite(near.distance)
        if scheme == SCHEME:
            usable[list(known_points or ())] = False
        triangle = np.where(usable, near.triangle, any_side.triangle)
        place = np.where(usable[:, None], near.weights, any_side.weights)
        tables[scheme] = np.concatenate(
            [surface.triangles[triangle], np.clip(place, 0.0, 1.0)], axis=1
        )
    return tables


def region_vertices(
    fit: Registration, vertices: np.ndarray, triangles: np.ndarray, on_skin: np.ndarray
) -> dict[str, np.ndarray]:
    """Region -> (r,) int32 vertices of the mesh that lie on that region of the default face;
    on_skin (n,) bool.
    """
    model = fit.model
    surface = Surface(fit.shape, model.triangles)
    back = fit.similarity.inverse().apply(vertices)
    own = vertex_normals(back, triangles) * (1.0 if fit.right_side_out else -1.0)
    nearest = surface.nearest(back, own, 0.3)
    regions = {}
    for name in _REGIONS:
        inside = np.zeros(len(model.vertices), bool)
        inside[model.regions[name]] = True
        there = inside[surface.triangles[nearest.triangle]].all(axis=1) & (
            nearest.distance < _REGION_REACH
        )
        regions[name] = np.flatnonzero(there & on_skin).astype(np.int32)
    return regions


def parts_of_pieces(
    fit: Registration, vertices: np.ndarray, triangles: np.ndarray, piece: np.ndarray
) -> np.ndarray:
    """(pieces,) uint8 part of every connected piece (n,) of a mesh, by what the default face has in
    its place.
    """
    model = fit.model
    part_of = np.full(len(model.vertices), SKIN, np.uint8)
    part_of[model.triangles] = model.triangle_part[:, None]
    distance, index = cKDTree(fit.shape).query(fit.similarity.inverse().apply(vertices))
    count = int(piece.max()) + 1
    votes = np.zeros((count, OTHER + 1))
    near = distance < _PIECE_REACH
    np.add.at(votes, (piece[near], part_of[index[near]]), 1)
    result = votes.argmax(axis=1).astype(np.uint8)
    size = np.bincount(piece, minlength=count)
    _, area = normals_and_areas(np.asarray(vertices, np.float64), triangles)
    area = np.bincount(piece[triangles[:, 0]], area, count)
    main = piece[fit.target.triangles[0, 0]]
    small = area < _SKIN_SHARE * area[main]
    result[(votes.sum(axis=1) < 0.5 * size) | ((result == SKIN) & small)] = OTHER
    result[(result != EYES) & ~small] = SKIN
    result[main] = SKIN
    return result
