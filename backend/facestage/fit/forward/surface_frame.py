"""How the texture lies on the skin: which way u and v run, and how far, at each point; and what a
normal map or a height map makes of its normals.

A normal map is in the tangent space of the UVs, as Blender and glTF have it (MikkTSpace): red along
u, green along v, blue outwards, each 0 to 1 for -1 to 1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Float, Integer
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.mixing import mixed
from facestage.fit.forward.shading import Surface, sample_bilinear


@dataclass(frozen=True)
class Frames:
    """P points: the shading normal, and the place's derivative by the texture coordinates along
    it, in the frame and unit of the vertices.
    """

    normals: Float[np.ndarray, "points 3"]  # unit
    by_u: Float[np.ndarray, "points 3"]
    by_v: Float[np.ndarray, "points 3"]

    @property
    def gradients(self) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
        """The surface's gradients of u and of v: with them that of any h(u, v) is
        h_u grad u + h_v grad v.
        """
        area = self.area[:, None]
        return np.cross(self.by_v, self.normals) / area, np.cross(self.normals, self.by_u) / area

    @property
    def area(self) -> Float[np.ndarray, " points"]:
        """Of skin per area of the texture; negative where the texture is mirrored."""
        area = np.einsum("px,px->p", self.normals, np.cross(self.by_u, self.by_v))
        return np.where(np.abs(area) < 1e-12, 1e-12, area)

    @property
    def tangents(self) -> tuple[Float[np.ndarray, "points 3"], Float[np.ndarray, "points 3"]]:
        """Unit tangent along u and bitangent, as MikkTSpace has them: n x t, turned where the
        texture is mirrored.
        """
        tangent = self.by_u / np.maximum(np.linalg.norm(self.by_u, axis=1, keepdims=True), 1e-12)
        return tangent, np.sign(self.area)[:, None] * np.cross(self.normals, tangent)

    def slopes(
        self, by_u: Float[np.ndarray, " points"], by_v: Float[np.ndarray, " points"]
    ) -> Float[np.ndarray, "points 3"]:
        """The surface's gradient of a height with these derivatives by the texture coordinates, in
        the unit of the vertices.
        """
        along_u, along_v = self.gradients
        return along_u * by_u[:, None] + along_v * by_v[:, None]

    def in_tangent_space(
        self, normals: Float[np.ndarray, "points 3"]
    ) -> Float[np.ndarray, "points 3"]:
        """Unit normals by tangent, bitangent and the smooth surface's normal."""
        axes = (*self.tangents, self.normals)
        return np.stack([np.einsum("px,px->p", normals, axis) for axis in axes], axis=1)

    def from_tangent_space(
        self, values: Float[np.ndarray, "points 3"]
    ) -> Float[np.ndarray, "points 3"]:
        """The reverse of :meth:`in_tangent_space`, made unit again."""
        axes = (*self.tangents, self.normals)
        total = sum(values[:, k, None] * axis for k, axis in enumerate(axes))
        return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))


def turned(
    normals: Float[np.ndarray, "points 3"], slopes: Float[np.ndarray, "points 3"]
) -> Float[np.ndarray, "points 3"]:
    """Unit normals of a surface with relief of these slopes on it."""
    result = normals - slopes
    return result / np.maximum(np.linalg.norm(result, axis=1, keepdims=True), 1e-12)


@dataclass(frozen=True)
class FrameField:
    """The frames of a mesh at its corners of the texture, to be mixed over triangles."""

    geometry: FaceGeometry
    vertex_normals: Float[np.ndarray, "vertices 3"]
    by_u: Float[np.ndarray, "corners 3"]
    by_v: Float[np.ndarray, "corners 3"]

    @classmethod
    def of(cls, geometry: FaceGeometry, vertices: Float[np.ndarray, "vertices 3"]) -> FrameField:
        """The mesh at ``vertices``."""
        uvs = geometry.model.uvs[geometry.triangle_uvs].astype(np.float64)
        points = vertices[geometry.triangles]
        sides, flat = points[:, 1:] - points[:, :1], uvs[:, 1:] - uvs[:, :1]
        area = flat[:, 0, 0] * flat[:, 1, 1] - flat[:, 0, 1] * flat[:, 1, 0]
        # Times the area in the texture, so that slivers count for little.
        by_u = flat[:, 1, 1, None] * sides[:, 0] - flat[:, 0, 1, None] * sides[:, 1]
        by_v = flat[:, 0, 0, None] * sides[:, 1] - flat[:, 1, 0, None] * sides[:, 0]
        turned = np.sign(area)
        count, corner = len(geometry.model.uvs), geometry.triangle_uvs

        def mean(values: Float[np.ndarray, "triangles 3"]) -> Float[np.ndarray, "corners 3"]:
            total = np.zeros((count, 3))
            for which in range(3):
                for axis in range(3):
                    total[:, axis] += np.bincount(corner[:, which], turned * values[:, axis], count)
            return total / np.maximum(weight, 1e-20)[:, None]

        weight = sum(np.bincount(corner[:, which], np.abs(area), count) for which in range(3))
        return cls(geometry, geometry.vertex_normals(vertices)[0], mean(by_u), mean(by_v))

    def at(
        self, triangle: Integer[np.ndarray, " points"], weights: Float[np.ndarray, "points 3"]
    ) -> Frames:
        """In rendered triangles (P,) at barycentric ``weights``."""
        corners = self.geometry.triangle_uvs[triangle]

        normals = mixed(weights, self.geometry.triangles[triangle], self.vertex_normals)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)

        def along(values: Float[np.ndarray, "points 3"]) -> Float[np.ndarray, "points 3"]:
            return values - normals * np.einsum("px,px->p", normals, values)[:, None]

        return Frames(
            normals,
            along(mixed(weights, corners, self.by_u)),
            along(mixed(weights, corners, self.by_v)),
        )

    def mapped(
        self,
        surface: Surface,
        uvs: Float[np.ndarray, "pixels 2"],
        normal_map: Float[np.ndarray, "texels texels 3"],
        rotation: Float[np.ndarray, "3 3"],
    ) -> Surface:
        """``surface`` with the normals of a normal map; ``rotation`` from the vertices' frame to
        the surface's.
        """
        frames = self.at(surface.triangle, surface.weights)
        found = frames.from_tangent_space(2 * sample_bilinear(normal_map, uvs) - 1)
        return replace(surface, normals=found @ rotation.T)
