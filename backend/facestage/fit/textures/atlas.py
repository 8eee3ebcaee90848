"""Which point of the face each texel of a texture shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from facestage.contract.arrays import Bool, Float, Float32, Int
from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.render.tracer import Hits, RayTracer


@dataclass(frozen=True)
class Atlas:
    """Which point of the mesh each texel of a texture shows."""

    size: int
    covered: Bool[np.ndarray, "size size"]
    skin: Bool[np.ndarray, "size size"]
    corners: Int[np.ndarray, "texels 3"]  # vertex indices
    weights: Float[np.ndarray, "texels 3"]  # barycentric
    triangle: Int[np.ndarray, " texels"]  # triangle of the rendered mesh
    # row and column of the nearest covered texel
    nearest: tuple[Int[np.ndarray, "size size"], Int[np.ndarray, "size size"]]

    @classmethod
    def build(cls, geometry: FaceGeometry, size: int) -> Atlas:
        """Rasterise the UV triangles by tracing one ray through each texel's centre."""
        v, u = np.mgrid[:size, :size]
        hits = shown_at(geometry, (u + 0.5) / size, 1.0 - (v + 0.5) / size)
        covered = (hits.triangle >= 0).reshape(size, size)
        triangle = hits.triangle[hits.triangle >= 0]
        skin = np.zeros((size, size), bool)
        skin[covered] = geometry.triangle_part[triangle] == SKIN
        nearest = distance_transform_edt(~covered, return_distances=False, return_indices=True)
        return cls(
            size,
            covered,
            skin,
            geometry.triangles[triangle],
            hits.barycentric[hits.triangle >= 0],
            triangle,
            (nearest[0], nearest[1]),
        )

    def bake(
        self, values: Float[np.ndarray, "vertices channels"]
    ) -> Float32[np.ndarray, "size size channels"]:
        """Texture of vertex values; uncovered texels repeat the nearest covered one."""
        texture = np.zeros((self.size, self.size, values.shape[1]), np.float32)
        texture[self.covered] = np.einsum("ti,tic->tc", self.weights, values[self.corners])
        return texture[self.nearest]


def shown_at(
    geometry: FaceGeometry, u: Float[np.ndarray, "_ _"], v: Float[np.ndarray, "_ _"]
) -> Hits:
    """Which triangle of the rendered mesh points of the UV square show."""
    uvs = geometry.model.uvs
    tracer = RayTracer(geometry.triangle_uvs, len(uvs))
    tracer.update(np.concatenate([uvs, np.zeros((len(uvs), 1))], axis=1))
    origin = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=-1)
    return tracer.first_hits(origin, np.broadcast_to([0.0, 0.0, -1.0], origin.shape))
