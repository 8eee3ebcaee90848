"""The rendered part of a face model: vertices, normals, and how they move with the coefficients."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Bool, Float, Float32, Float64, Int
from facestage.contract.face_model import OTHER, SKIN, FaceModel
from facestage.fit.face.curvature import MovingCurvature
from facestage.fit.face.state import State

# Metres per standard deviation or unit weight: a mode that moves a vertex less does not move it.
INFLUENCE_MIN = 1e-7

NO_RELIEF = np.zeros(0)
ALL = slice(None)
# Every term of a step, and every photo of a person, asks for the same few shapes again.
SHAPES_KEPT = 8


class FaceGeometry:
    """A face model reduced to the m vertices that are rendered, with stacked shape bases.

    ``basis`` is (3 m, k + e + r) float32, identity modes first, then expressions, then relief;
    coordinates interleaved (x0, y0, z0, x1, ...). ``fitted`` marks the triangles whose pixels are
    compared with the photo.
    """

    def __init__(
        self, model: FaceModel, relief: Float32[np.ndarray, "reliefs vertices 3"] | None = None
    ) -> None:
        """``relief``: metres by unit weight, what the shape may have beyond the model's modes."""
        if relief is None:
            relief = np.zeros((0, len(model.vertices), 3), np.float32)
        rendered = model.triangle_part != OTHER
        used = np.unique(model.triangles[rendered])
        new_index = np.full(len(model.vertices), -1, np.int64)
        new_index[used] = np.arange(len(used))
        self.model = model
        self.used = used
        self.new_index = new_index
        self.triangles = new_index[model.triangles[rendered]]
        self.triangle_uvs = model.triangle_uvs[rendered]
        self.triangle_part = model.triangle_part[rendered]
        self.fitted = self.triangle_part == SKIN
        if "face" in model.regions:
            # Scalp and neck are where hair, hats and collars are.
            face = np.zeros(len(model.vertices), bool)
            face[model.regions["face"]] = True
            self.fitted &= face[used][self.triangles].all(axis=1)
        self.mean = model.vertices[used].astype(np.float64)
        self.relief_basis = relief
        bases = (model.identity_basis, model.expression_basis, relief)
        shapes = [basis[:, used].reshape(len(basis), 3 * len(used)) for basis in bases]
        self.basis = np.ascontiguousarray(np.concatenate(shapes).T)
        self._shapes: dict[bytes, np.ndarray] = {}  # by their weights, the last one last
        self._last_modes: tuple[np.ndarray, np.ndarray] | None = None
        self.log_albedo = np.log(model.albedo_mean[used])
        self.albedo_basis = np.ascontiguousarray(model.albedo_basis[:, used])

    @property
    def model_basis(self) -> Float[np.ndarray, "coordinates modes"]:
        """``basis`` without relief."""
        return self.basis[:, : self.basis.shape[1] - len(self.relief_basis)]

    @cached_property
    def influence(self) -> Bool[np.ndarray, "vertices modes"]:
        """Which modes move a vertex by more than INFLUENCE_MIN per unit weight."""
        return np.abs(self.basis).reshape(len(self.mean), 3, -1).max(axis=1) > INFLUENCE_MIN

    @cached_property
    def fitted_vertices(self) -> Int[np.ndarray, " _"]:
        """The vertices of the triangles that are compared with the photo."""
        return np.unique(self.triangles[self.fitted])

    @cached_property
    def albedo_columns(self) -> Float32[np.ndarray, "3 vertices albedos"]:
        """The albedo modes by channel, contiguous for sparse products."""
        return np.ascontiguousarray(self.albedo_basis.transpose(2, 1, 0), np.float32)

    def vertices(
        self,
        identity: Float[np.ndarray, " identities"],
        expression: Float[np.ndarray, " expressions"],
        relief: Float[np.ndarray, " reliefs"] = NO_RELIEF,
    ) -> Float64[np.ndarray, "vertices 3"]:
        """Model-frame positions, not to be written to; without weights of the relief there is
        none.
        """
        weights = np.concatenate([identity, expression, relief]).astype(np.float32)
        key = weights.tobytes()
        found = self._shapes.pop(key, None)
        if found is None:
            found = self.mean + (self.basis[:, : len(weights)] @ weights).reshape(-1, 3)
            found.flags.writeable = False
        self._shapes[key] = found  # now the last one
        while len(self._shapes) > SHAPES_KEPT:
            del self._shapes[next(iter(self._shapes))]
        return found

    def at(self, state: State) -> Float64[np.ndarray, "vertices 3"]:
        """Model-frame positions at ``state``."""
        return self.vertices(state.identity, state.expression, state.relief)

    def all_vertices(self, state: State) -> Float32[np.ndarray, "vertices 3"]:
        """Model-frame positions of every vertex of the model, in its order."""
        return self.model.shape(state.identity, state.expression) + self.relief(state)

    def relief(self, state: State) -> Float32[np.ndarray, "vertices 3"]:
        """Metres by which the shape at ``state`` differs from the model's, every vertex of it."""
        weights = state.relief.astype(np.float32)
        return np.tensordot(weights, self.relief_basis[: len(weights)], 1)

    def modes(self, some: Int[np.ndarray, " modes"]) -> Float32[np.ndarray, "coordinates modes"]:
        """Columns of the basis; those that were asked for last are at hand."""
        if len(some) == self.basis.shape[1]:
            return self.basis
        if self._last_modes is None or not np.array_equal(self._last_modes[0], some):
            self._last_modes = some, np.ascontiguousarray(self.basis[:, some])
        return self._last_modes[1]

    def face_normals(
        self, vertices: Float[np.ndarray, "vertices 3"], some: Int[np.ndarray, " _"] | slice = ALL
    ) -> Float[np.ndarray, "triangles 3"]:
        """Normals of length twice the triangle's area, of ``some`` triangles."""
        a, b, c = (vertices[self.triangles[some, corner]] for corner in range(3))
        return np.cross(b - a, c - a)

    def vertex_normals(
        self, vertices: Float[np.ndarray, "vertices 3"], some: Int[np.ndarray, " _"] | slice = ALL
    ) -> tuple[Float[np.ndarray, "vertices 3"], Float[np.ndarray, " vertices"]]:
        """Unit normals, area-weighted, and the lengths before normalising; right where all
        triangles of a vertex are among ``some``.
        """
        faces = self.face_normals(vertices, some)
        total = np.zeros_like(vertices)
        for axis in range(3):
            for corner in range(3):
                total[:, axis] += np.bincount(
                    self.triangles[some, corner], faces[:, axis], len(vertices)
                )
        length = np.linalg.norm(total, axis=1)
        return total / np.maximum(length, 1e-20)[:, None], length

    @cached_property
    def bends(self) -> MovingCurvature:
        """The mean curvature of the rendered mesh in any shape."""
        return MovingCurvature(self.triangles, len(self.mean))

    def normal_operator(
        self, vertices: Float[np.ndarray, "vertices 3"], wanted: Bool[np.ndarray, " vertices"]
    ) -> sp.csr_matrix:
        """(3 w, 3 m) sparse derivative of the unnormalised normals of the ``wanted`` vertices by
        the positions of all.

        A triangle's normal is a x b + b x c + c x a, so moving a adds da x (b - c), and so on
        around.
        """
        pointer, beside, opposite = self._pairs
        counts = np.where(wanted, np.diff(pointer), 0)
        pairs = np.flatnonzero(np.repeat(wanted, np.diff(pointer)))
        x, y, z = (opposite[pairs] @ vertices).astype(np.float32).T
        # da x e = -[e]x da: each row of the skew matrix has two non-zero entries.
        entries = np.stack([z, -y, -z, x, y, -x], axis=-1).reshape(-1, 3, 2)
        columns = 3 * beside[pairs, None, None] + np.array([[1, 2], [0, 2], [0, 1]])
        # Row by row of each vertex, and all its neighbours in each row.
        count = counts[wanted]
        start = np.repeat(np.cumsum(count) - count, count)
        place = 2 * start + np.arange(len(pairs))
        place = place[:, None] + np.repeat(count, count)[:, None] * np.arange(3)
        data, indices = (
            np.empty((3 * len(pairs), 2), np.float32),
            np.empty((3 * len(pairs), 2), int),
        )
        data[place], indices[place] = entries, columns
        rows = np.concatenate([[0], np.cumsum(np.repeat(2 * count, 3))])
        shape = (3 * len(count), 3 * len(vertices))
        return sp.csr_matrix((data.ravel(), indices.ravel(), rows), shape=shape)

    @cached_property
    def _pairs(self) -> tuple[np.ndarray, np.ndarray, sp.csr_matrix]:
        """Which vertices' places turn which vertex's normal: where those of each vertex begin
        (m + 1,), the other of each pair, and (pairs, m) what lies opposite of it, as a sum of
        positions. Around a vertex in the middle of the mesh, its own place cancels.
        """
        count = len(self.mean)
        normal, moved, ahead = (np.zeros(0, np.int64) for _ in range(3))
        behind = ahead
        for target in range(3):
            for source in range(3):
                normal = np.append(normal, self.triangles[:, target])
                moved = np.append(moved, self.triangles[:, source])
                ahead = np.append(ahead, self.triangles[:, (source + 1) % 3])
                behind = np.append(behind, self.triangles[:, (source + 2) % 3])
        names, pair = np.unique(normal * count + moved, return_inverse=True)
        signs = np.repeat([1.0, -1.0], len(pair))
        index = (np.tile(pair, 2), np.concatenate([ahead, behind]))
        opposite = sp.csr_matrix((signs, index), shape=(len(names), count))
        opposite.eliminate_zeros()
        kept = np.diff(opposite.indptr) > 0
        pointer = np.searchsorted(names[kept] // count, np.arange(count + 1))
        return pointer, names[kept] % count, opposite[kept]
