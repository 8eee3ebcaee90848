"""What the default model knows of its face, carried over to another mesh that it was registered to."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from facestage.models.registration import SCHEME, Registration, register
from facestage.models.registry import load_model
from facestage.models.surface import Surface, vertex_normals

_COSINE = 0.2


def transfer_landmarks(
    vertices: np.ndarray,
    triangles: np.ndarray,
    known_points: Mapping[int, np.ndarray] | None = None,
    focus: np.ndarray | None = None,
) -> dict[str, np.ndarray]:
    """Landmark tables of a face mesh (see FaceModel.landmarks) for every scheme that the default model has.

    vertices (n, 3) and triangles (t, 3): the mesh, any unit and axes. known_points, focus: see
    :func:`facestage.models.registration.register`. Returns scheme -> (m, 6) float64: three vertex indices and their
    barycentric weights. Raises InputError when no face is found.
    """
    fit = register(load_model("default"), vertices, triangles, known_points, focus)
    return landmark_tables(fit, vertices, triangles, known_points)


def landmark_tables(
    fit: Registration,
    vertices: np.ndarray,
    triangles: np.ndarray,
    known_points: Mapping[int, np.ndarray] | None = None,
) -> dict[str, np.ndarray]:
    """The default model's landmark tables on the mesh (vertices, triangles) that ``fit`` was made for.

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
        tables[scheme] = np.concatenate([surface.triangles[triangle], np.clip(place, 0.0, 1.0)], axis=1)
    return tables
