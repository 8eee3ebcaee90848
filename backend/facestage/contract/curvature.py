"""Mean curvature of a mesh: where skin bulges and where it is hollow. Shared by the fit and the
Blender material.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.contract.scattering import CURVATURE_MAX

SMOOTHED = 2  # times that each vertex is averaged with the mean of its neighbours


class Curvature:
    """Of any shape of one mesh."""

    def __init__(self, triangles: Int[np.ndarray, "triangles 3"], vertices: int) -> None:
        self.triangles, self.count = triangles, vertices
        sides = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
        ends = np.sort(sides, axis=1).astype(np.int64)
        # One number for both ends is sorted many times faster than pairs.
        self.edges = np.stack(np.divmod(np.unique(ends[:, 0] * vertices + ends[:, 1]), vertices), 1)
        self.neighbours = np.maximum(np.bincount(self.edges.ravel(), minlength=vertices), 1)

    def of(self, vertices: Float[np.ndarray, "vertices 3"]) -> Float[np.ndarray, " vertices"]:
        """1 / m, convex positive, with area-weighted normals of the triangles."""
        a, b, c = (vertices[self.triangles[:, corner]] for corner in range(3))
        faces, normals = np.cross(b - a, c - a), np.zeros((self.count, 3))
        for axis in range(3):
            normals[:, axis] = np.bincount(
                self.triangles.T.ravel(), np.tile(faces[:, axis], 3), self.count
            )
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        return self.at(vertices, normals / np.maximum(length, 1e-20))

    def at(
        self, vertices: Float[np.ndarray, "vertices 3"], normals: Float[np.ndarray, "vertices 3"]
    ) -> Float[np.ndarray, " vertices"]:
        """1 / m, convex positive; ``normals`` of length 1.

        The normals' change along the edges of each vertex, over the edges: on a sphere 1 / radius.
        """
        return np.clip(self.smoothed(vertices, normals), -CURVATURE_MAX, CURVATURE_MAX)

    def smoothed(
        self, vertices: Float[np.ndarray, "vertices 3"], normals: Float[np.ndarray, "vertices 3"]
    ) -> Float[np.ndarray, " vertices"]:
        """The same, not yet limited."""
        first, second = self.edges.T
        along, bend = vertices[second] - vertices[first], normals[second] - normals[first]
        result = self.ends(np.einsum("ex,ex->e", bend, along)) / np.maximum(
            self.ends(np.einsum("ex,ex->e", along, along)), 1e-20
        )
        for _ in range(SMOOTHED):
            around = np.bincount(first, result[second], self.count)
            around += np.bincount(second, result[first], self.count)
            result = 0.5 * (result + around / self.neighbours)
        return result

    def ends(self, values: Float[np.ndarray, " edges"]) -> Float[np.ndarray, " vertices"]:
        """The sum over the edges that end at each vertex."""
        first, second = self.edges.T
        return np.bincount(first, values, self.count) + np.bincount(second, values, self.count)
