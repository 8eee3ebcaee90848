"""Which point of the face each texel of a texture shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt

from facestage.contract.arrays import Bool, Float, Float32, Int
from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.render.tracer import Hits, RayTracer

BLOCK = 2**20  # texels that are worked on at once


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
        centre = (np.arange(size) + 0.5) / size
        rows = max(BLOCK // size, 1)
        blocks = [
            shown_at(geometry, *np.meshgrid(centre, 1.0 - centre[start : start + rows]))
            for start in range(0, size, rows)
        ]
        every = np.concatenate([block.triangle for block in blocks])
        shows = every >= 0
        triangle, covered = every[shows], shows.reshape(size, size)
        weights = np.concatenate([each.barycentric[each.triangle >= 0] for each in blocks])
        del blocks, every
        skin = np.zeros((size, size), bool)
        skin[covered] = geometry.triangle_part[triangle] == SKIN
        nearest = distance_transform_edt(~covered, return_distances=False, return_indices=True)
        return cls(
            size,
            covered,
            skin,
            geometry.triangles.astype(np.int32)[triangle],
            weights,
            triangle,
            (nearest[0].astype(np.int16), nearest[1].astype(np.int16)),
        )

    def bake(
        self, values: Float[np.ndarray, "vertices channels"]
    ) -> Float32[np.ndarray, "size size channels"]:
        """Texture of vertex values; uncovered texels repeat the nearest covered one."""
        texture = np.zeros((self.size, self.size, values.shape[1]), np.float32)
        for rows, found in self.baked(values):
            texture[rows][self.covered[rows]] = found
        return texture[self.nearest]

    def baked(
        self, values: Float[np.ndarray, "vertices channels"]
    ) -> Iterator[tuple[slice, Float[np.ndarray, "_ channels"]]]:
        """Vertex values of the covered texels, some rows of the texture after others."""
        step = max(BLOCK // self.size, 1)
        first = np.concatenate([[0], np.cumsum(self.covered.sum(axis=1))])
        for start in range(0, self.size, step):
            end = min(start + step, self.size)
            part = slice(first[start], first[end])
            found = np.einsum("ti,tic->tc", self.weights[part], values[self.corners[part]])
            yield slice(start, end), found


def shown_at(
    geometry: FaceGeometry, u: Float[np.ndarray, "_ _"], v: Float[np.ndarray, "_ _"]
) -> Hits:
    """Which triangle of the rendered mesh points of the UV square show."""
    uvs = geometry.model.uvs
    tracer = RayTracer(geometry.triangle_uvs, len(uvs))
    tracer.update(np.concatenate([uvs, np.zeros((len(uvs), 1))], axis=1))
    origin = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=-1)
    return tracer.first_hits(origin, np.broadcast_to([0.0, 0.0, -1.0], origin.shape))
