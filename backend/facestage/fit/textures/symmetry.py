"""Which texel of the atlas shows the same point of the face's other side."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.arrays import Float, Int, Integer
from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.atlas import Atlas
from facestage.models.mesh.surface import closest_weights

MIRROR = np.array([-1.0, 1.0, 1.0])
# A texel whose mirrored point lies farther from the point that it was given, in metres and in
# texels, has none: a seam runs through its triangle's image, or the model is not symmetric there.
DISTANCE_MAX, TEXELS_MAX = 1e-3, 1.5
NEAR_VERTICES = 2


def mirrored_texels(atlas: Atlas, geometry: FaceGeometry) -> Int[np.ndarray, "size size"]:
    """The flat index of the skin texel at each skin texel's mirror point on the mean
    face, -1 if none.

    Every vertex of the skin is reflected at x = 0 and put on the nearest point of the skin, whose
    texture coordinates are then interpolated over the triangles as any vertex value.
    """
    size = atlas.size
    result = np.full(size * size, -1)
    skin = geometry.triangles[geometry.triangle_part == SKIN]
    skin_uvs = geometry.triangle_uvs[geometry.triangle_part == SKIN]
    used = np.unique(skin)
    triangle, weights = nearest_points(geometry.mean[used] * MIRROR, geometry.mean, skin)
    mirrored = np.zeros((len(geometry.mean), 2))
    mirrored[used] = np.einsum(
        "vi,vix->vx", weights, geometry.model.uvs[skin_uvs[triangle]].astype(np.float64)
    )
    texels = np.flatnonzero(atlas.skin)
    own = atlas.skin[atlas.covered]
    corners, share = atlas.corners[own], atlas.weights[own].astype(np.float64)
    uvs = np.einsum("ti,tix->tx", share, mirrored[corners])
    place = np.einsum("ti,tix->tx", share, geometry.mean[corners])
    column, row = (
        np.floor(np.stack([uvs[:, 0], 1 - uvs[:, 1]]) * size).astype(int).clip(0, size - 1)
    )
    found = row * size + column
    positions = np.full((size * size, 3), np.inf)
    positions[texels] = place
    valid = atlas.skin.ravel()[found]
    distance = np.full(len(texels), np.inf)
    distance[valid] = np.linalg.norm(positions[found[valid]] - place[valid] * MIRROR, axis=1)
    result[texels] = np.where(
        distance <= DISTANCE_MAX + TEXELS_MAX * _texel_size(positions, size)[texels], found, -1
    )
    return result.reshape(size, size)


def nearest_points(
    points: Float[np.ndarray, "points 3"],
    vertices: Float[np.ndarray, "vertices 3"],
    triangles: Integer[np.ndarray, "triangles 3"],
) -> tuple[Int[np.ndarray, " points"], Float[np.ndarray, "points 3"]]:
    """Triangle and barycentric weights of the mesh's nearest point to each of
    ``points``.

    Looked for on the triangles around each point's nearest vertices, so right where triangles are
    as large as their neighbours.
    """
    used, order = np.unique(triangles), np.argsort(triangles.ravel(), kind="stable")
    first = np.searchsorted(triangles.ravel()[order], np.arange(len(vertices) + 1))
    near = used[
        cKDTree(vertices[used])
        .query(points, k=min(NEAR_VERTICES, len(used)))[1]
        .reshape(len(points), -1)
    ]
    counts = (first[near + 1] - first[near]).ravel()
    owner = np.repeat(np.repeat(np.arange(len(points)), near.shape[1]), counts)
    within = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    candidate = order[np.repeat(first[near].ravel(), counts) + within] // 3
    weights = closest_weights(points[owner], vertices[triangles[candidate]])
    offset = np.einsum("ci,cix->cx", weights, vertices[triangles[candidate]]) - points[owner]
    distance = (offset**2).sum(1)
    best = np.lexsort((distance, owner))
    best = best[np.searchsorted(owner[best], np.arange(len(points)))]
    return candidate[best], weights[best]


def _texel_size(
    positions: Float[np.ndarray, "texels 3"], size: int
) -> Float[np.ndarray, " texels"]:
    """Metres from a texel to its neighbours, the larger of right and below; 0 where there
    is none.
    """
    grid = positions.reshape(size, size, 3)
    result = np.zeros((size, size))
    with np.errstate(invalid="ignore"):
        right = np.linalg.norm(grid[:, 1:] - grid[:, :-1], axis=2)
        below = np.linalg.norm(grid[1:] - grid[:-1], axis=2)
    result[:, :-1] = np.where(np.isfinite(right), right, 0)
    result[:-1] = np.maximum(result[:-1], np.where(np.isfinite(below), below, 0))
    # Across a seam two neighbours may be far apart on the face.
    return np.minimum(
        result, 4 * np.median(result[result > 0]) if (result > 0).any() else 0.0
    ).ravel()
