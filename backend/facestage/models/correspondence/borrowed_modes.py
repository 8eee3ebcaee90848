"""The default model's identity modes on another mesh, so that a rig without any can still take a
person's shape.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from facestage.contract.face_model import SKIN, TEETH
from facestage.models.correspondence.registration import Registration
from facestage.models.mesh.surface import pieces, vertex_normals

_NEIGHBORS = 12
_REACH = 6e-3  # metres on the default face
_FADE = 40e-3  # metres beyond which a vertex belongs to no head


def borrowed_modes(
    fit: Registration, vertices: np.ndarray, triangles: np.ndarray, part: np.ndarray
) -> np.ndarray:
    """(k, n, 3) float64 offsets at one standard deviation, in the mesh's coordinates.

    vertices (n, 3), triangles (t, 3), part (t,) index into PARTS. A vertex moves as the default
    face below it does, averaged over a few millimetres, skin as all of it but its teeth; loose
    pieces that are not skin (eyes, teeth) move as a whole: they are turned, shifted and scaled,
    never bent.
    """
    model = fit.model
    back = fit.similarity.inverse().apply(vertices)
    distance, index = cKDTree(fit.shape).query(back, k=_NEIGHBORS)
    skin = np.zeros(len(vertices), bool)
    skin[triangles[part == SKIN]] = True
    # Teeth that stand higher take no lips along.
    others = np.unique(model.triangles[model.triangle_part != TEETH])
    distance[skin], nearest_other = cKDTree(fit.shape[others]).query(back[skin], k=_NEIGHBORS)
    index[skin] = others[nearest_other]
    nearest = distance[:, :1]
    weights = np.exp(-0.5 * (distance**2 - nearest**2) / _REACH**2)
    normals = vertex_normals(fit.shape, model.triangles)
    own = vertex_normals(back, triangles) * (1.0 if fit.right_side_out else -1.0)
    # The upper lip does not follow the lower one that it touches.
    facing = np.einsum("nkc,nc->nk", normals[index], own)
    weights *= np.where(facing > 0, 1.0, 0.02)
    weights /= weights.sum(axis=1, keepdims=True)
    weights *= np.exp(-0.5 * (np.maximum(nearest - _REACH, 0) / _FADE) ** 2)
    rows = np.repeat(np.arange(len(vertices)), _NEIGHBORS)
    average = csr_matrix((weights.ravel(), (rows, index.ravel())), (len(vertices), len(fit.shape)))
    modes = np.stack([average @ mode for mode in model.identity_basis.astype(np.float64)])
    _stiffen(modes, back, triangles, part)
    return fit.similarity.scale * modes @ fit.similarity.rotation.T


def _stiffen(
    modes: np.ndarray, points: np.ndarray, triangles: np.ndarray, part: np.ndarray
) -> None:
    """Replace the offsets of each loose piece that is not skin by the nearest ones that only turn,
    shift and scale.
    """
    skin = np.zeros(len(points), bool)
    skin[triangles[part == SKIN]] = True
    piece = pieces(points, triangles)
    for label in np.unique(piece):
        chosen = np.flatnonzero(piece == label)
        if skin[chosen].any():
            continue
        x, y, z = (points[chosen] - points[chosen].mean(axis=0)).T
        zero, one = np.zeros_like(x), np.ones_like(x)
        fields = (
            (one, zero, zero),
            (zero, one, zero),
            (zero, zero, one),
            (zero, -z, y),
            (z, zero, -x),
            (-y, x, zero),
            (x, y, z),
        )
        columns = np.stack([np.stack(field, axis=1).ravel() for field in fields], axis=1)
        flat = modes[:, chosen].reshape(len(modes), -1)
        moved = columns @ np.linalg.lstsq(columns, flat.T, rcond=None)[0]
        modes[:, chosen] = moved.T.reshape(len(modes), len(chosen), 3)
