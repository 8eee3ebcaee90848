"""Normals of a few vertices, without the shape and the normals of the rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Float, Float32, Int
from facestage.fit.face.geometry import FaceGeometry


@dataclass(frozen=True)
class NormalsAt:
    """The unit normals of n chosen vertices, in any shape of the mesh."""

    mean: Float[np.ndarray, "corners 3"]  # the vertices of the triangles around the chosen ones
    basis: Float32[np.ndarray, "coordinates modes"]  # theirs, as :class:`FaceGeometry` has it
    triangles: Int[np.ndarray, "triangles 3"]  # indices into these vertices
    sums: sp.csr_matrix  # (n, triangles), 1 where a triangle touches a chosen vertex

    @classmethod
    def of(cls, geometry: FaceGeometry, chosen: Int[np.ndarray, " n"]) -> Self:
        """``chosen``: rendered-vertex indices, in increasing order."""
        around = geometry.triangles[np.isin(geometry.triangles, chosen).any(axis=1)]
        triangle, corner = np.nonzero(np.isin(around, chosen))
        row = np.searchsorted(chosen, around[triangle, corner])
        sums = sp.csr_matrix((np.ones(len(row)), (row, triangle)), shape=(len(chosen), len(around)))
        vertices, triangles = np.unique(around, return_inverse=True)
        rows = (3 * vertices[:, None] + np.arange(3)).ravel()
        return cls(geometry.mean[vertices], geometry.basis[rows], triangles.reshape(-1, 3), sums)

    def at(self, weights: Float[np.ndarray, " modes"]) -> Float[np.ndarray, "n 3"]:
        """Area-weighted, of the whole mesh with ``weights`` of its modes, the first ones if they
        are fewer; model frame.
        """
        weights = weights.astype(np.float32)
        some = self.mean + (self.basis[:, : len(weights)] @ weights).reshape(-1, 3)
        a, b, c = (some[self.triangles[:, corner]] for corner in range(3))
        total = self.sums @ np.cross(b - a, c - a)
        return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1), 1e-20)[:, None])
