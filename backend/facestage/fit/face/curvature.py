"""How the curvature of a mesh changes as its vertices move."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Bool, Float, Int
from facestage.contract.curvature import SMOOTHED, Curvature
from facestage.contract.scattering import CURVATURE_MAX


class MovingCurvature(Curvature):
    """With derivatives."""

    def __init__(self, triangles: Int[np.ndarray, "triangles 3"], vertices: int) -> None:
        super().__init__(triangles, vertices)
        index = np.tile(np.arange(len(self.edges)), 2)
        ends = (np.ones(len(index)), (self.edges.T.ravel(), index))
        # (vertices, edges) which edges end at each vertex.
        self._ends = sp.csr_matrix(ends, shape=(vertices, len(self.edges)))
        first, second = self.edges.T
        beside = sp.coo_matrix((np.ones(len(first)), (first, second)), shape=(vertices, vertices))
        mean = sp.diags_array(1.0 / self.neighbours) @ (beside + beside.T)
        self._smooth = sp.csr_matrix(0.5 * (sp.eye_array(vertices) + mean))

    def around(self, wanted: Bool[np.ndarray, " vertices"]) -> Bool[np.ndarray, " vertices"]:
        """The vertices on whose place and normal the curvature at ``wanted`` hangs."""
        reach = wanted.astype(float)
        for _ in range(SMOOTHED):
            reach = self._smooth @ reach
        return wanted | (self._ends @ (self._ends.T @ reach) > 0)

    def change(
        self,
        vertices: Float[np.ndarray, "vertices 3"],
        normals: Float[np.ndarray, "vertices 3"],
        lengths: Float[np.ndarray, " vertices"],
        wanted: Bool[np.ndarray, " vertices"],
        moved: Float[np.ndarray, "coordinates modes"],
        turned: Float[np.ndarray, "coordinates modes"],
    ) -> Float[np.ndarray, "wanted modes"]:
        """How the curvature at ``wanted`` changes with the vertices :meth:`around` them, which are
        ``moved``, and whose normals are ``turned`` before they are normalised, by each mode.

        ``normals`` are of length 1, ``lengths`` those before.
        """
        near = self.around(wanted)
        edge = np.flatnonzero(near[self.edges].all(axis=1))
        ends = self._ends[near][:, edge]
        edges, place = self.edges[edge], np.cumsum(near) - 1
        along = vertices[edges[:, 1]] - vertices[edges[:, 0]]
        bend = normals[edges[:, 1]] - normals[edges[:, 0]]
        total = np.maximum(ends @ np.einsum("ex,ex->e", along, along), 1e-20)
        rough = (ends @ np.einsum("ex,ex->e", bend, along)) / total
        # By normals before they are normalised: the tangential part, over the length.
        unit = normals[edges]
        tangent = along[:, None] - np.einsum("ex,eix->ei", along, unit)[..., None] * unit
        tangent /= np.maximum(lengths[edges], 1e-20)[..., None]

        def differences(by: Float[np.ndarray, "edges 2 3"]) -> sp.csr_matrix:
            """(near, 3 near) what lies at the ends of each edge times ``by``, second less first."""
            signed = (by * [[-1.0], [1.0]]).ravel()
            column = 3 * place[edges][:, :, None] + np.arange(3)
            pointer = np.arange(0, len(signed) + 1, 6)
            shape = (len(edges), 3 * len(rough))
            return ends @ sp.csr_matrix((signed, column.ravel(), pointer), shape=shape)

        both = differences(np.stack([along, along], axis=1))
        by_place = differences(np.stack([bend, bend], axis=1)) - 2 * sp.diags_array(rough) @ both
        change = sp.csr_matrix(by_place).astype(moved.dtype) @ moved
        change += differences(tangent).astype(turned.dtype) @ turned
        change /= total[:, None]
        pick = self._smooth[wanted][:, near]
        for _ in range(SMOOTHED - 1):
            pick = pick @ self._smooth[near][:, near]
        result = pick.astype(moved.dtype) @ change
        result[np.abs(self.smoothed(vertices, normals)[wanted]) >= CURVATURE_MAX] = 0
        return result
