"""Which point of the face each texel of a texture shows."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Bool, Float, Float32, Int, Shaped
from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.mixing import mixed
from facestage.images.opencv import opencv
from facestage.render.tracer import Hits, RayTracer

BLOCK = 2**20  # texels that are worked on at once


@dataclass(frozen=True)
class Atlas:
    """Which point of the mesh each texel of a texture shows."""

    size: int
    covered: Bool[np.ndarray, "size size"]
    skin: Bool[np.ndarray, "size size"]
    weights: Float[np.ndarray, "texels 3"]  # barycentric
    triangle: Int[np.ndarray, " texels"]  # triangle of the rendered mesh
    triangles: Int[np.ndarray, "triangles 3"]  # their vertices
    # of each texel that is not covered, row by row, the number of the nearest that is, about
    nearest: Int[np.ndarray, " uncovered"]

    @property
    def corners(self) -> Int[np.ndarray, "texels 3"]:
        """Vertices around the point that each covered texel shows."""
        return self.triangles[self.triangle]

    @classmethod
    def build(cls, geometry: FaceGeometry, size: int) -> Atlas:
        """Rasterise the UV triangles by tracing one ray through each texel's centre."""
        centre = (np.arange(size) + 0.5) / size
        rows = max(BLOCK // size, 1)
        tracer = uv_tracer(geometry)
        blocks = [
            shown_at(tracer, *np.meshgrid(centre, 1.0 - centre[start : start + rows]))
            for start in range(0, size, rows)
        ]
        every = np.concatenate([block.triangle for block in blocks])
        shows = every >= 0
        triangle, covered = every[shows], shows.reshape(size, size)
        weights = np.concatenate([each.barycentric[each.triangle >= 0] for each in blocks])
        del blocks, every
        skin = np.zeros((size, size), bool)
        skin[covered] = geometry.triangle_part[triangle] == SKIN
        triangles = geometry.triangles.astype(np.int32)
        return cls(size, covered, skin, weights, triangle, triangles, nearest_covered(covered))

    def bake(
        self, values: Float[np.ndarray, "vertices channels"]
    ) -> Float32[np.ndarray, "size size channels"]:
        """Texture of vertex values; uncovered texels repeat the nearest covered one."""
        texture = np.zeros((self.size, self.size, values.shape[1]), np.float32)
        for rows, found in self.baked(values):
            texture[rows][self.covered[rows]] = found
        self.spread(texture)
        return texture

    def spread(self, texture: Shaped[np.ndarray, "size size ..."]) -> None:
        """Let the uncovered texels repeat the nearest covered one."""
        texture[~self.covered] = texture.reshape(self.size**2, *texture.shape[2:])[self.nearest]

    def baked(
        self, values: Float[np.ndarray, "vertices channels"]
    ) -> Iterator[tuple[slice, Float32[np.ndarray, "_ channels"]]]:
        """Vertex values of the covered texels, some rows of the texture after others."""
        step = max(BLOCK // self.size, 1)
        first = np.concatenate([[0], np.cumsum(self.covered.sum(axis=1))])
        values = values.astype(np.float32)
        for start in range(0, self.size, step):
            end = min(start + step, self.size)
            part = slice(first[start], first[end])
            corners = self.triangles[self.triangle[part]]
            # Several times faster than a sum over gathered corners.
            pick = sp.csr_matrix(
                (
                    self.weights[part].ravel(),
                    corners.ravel(),
                    np.arange(0, corners.size + 1, 3, dtype=np.int32),
                ),
                shape=(len(corners), len(values)),
            )
            yield slice(start, end), pick @ values

    def on(self, triangles: Bool[np.ndarray, " triangles"]) -> Int[np.ndarray, " near"]:
        """The numbers, among the covered texels, of those on such ``triangles``."""
        return np.flatnonzero(triangles[self.triangle])

    def at(
        self, texels: Int[np.ndarray, " near"], values: Float[np.ndarray, "vertices ..."]
    ) -> Float[np.ndarray, "near ..."]:
        """Vertex values at covered ``texels`` by number."""
        return mixed(self.weights[texels], self.triangles[self.triangle[texels]], values)

    def place(self, texels: Int[np.ndarray, " near"]) -> Int[np.ndarray, " near"]:
        """Where covered ``texels`` by number are, row by row."""
        return np.flatnonzero(self.covered)[texels]


class Atlases:
    """Those of one geometry, each built once."""

    def __init__(self, geometry: FaceGeometry) -> None:
        self._geometry, self._built = geometry, dict[int, Atlas]()

    def of(self, size: int) -> Atlas:
        """With ``size`` texels along a side."""
        if size not in self._built:
            self._built[size] = Atlas.build(self._geometry, size)
        return self._built[size]


def nearest_covered(covered: Bool[np.ndarray, "rows columns"]) -> Int[np.ndarray, " uncovered"]:
    """Of each texel that is not covered, row by row, the number of the nearest that is; of those
    far away of one about as near (Borgefors 1986).
    """
    cv2 = opencv()
    _, labels = cv2.distanceTransformWithLabels(
        (~covered).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    number = np.zeros(int(labels.max()) + 1, np.int64)
    number[labels[covered]] = np.flatnonzero(covered)
    return number[labels[~covered]]


def uv_tracer(geometry: FaceGeometry) -> RayTracer:
    """The UV triangles of the rendered mesh, in the plane of height 0."""
    uvs = geometry.model.uvs
    tracer = RayTracer(geometry.triangle_uvs, len(uvs))
    tracer.update(np.concatenate([uvs, np.zeros((len(uvs), 1))], axis=1))
    return tracer


def shown_at(tracer: RayTracer, u: Float[np.ndarray, "_ _"], v: Float[np.ndarray, "_ _"]) -> Hits:
    """Which triangle of a :func:`uv_tracer` points of the UV square show."""
    origin = np.stack([u.ravel(), v.ravel(), np.ones(u.size)], axis=-1)
    return tracer.first_hits(origin, np.broadcast_to([0.0, 0.0, -1.0], origin.shape))
