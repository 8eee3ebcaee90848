"""Points fixed on the face's surface: where they are, where they show, and how both move with the
parameters.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float, Int, Shaped
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State


class SurfacePoints:
    """m points of the rendered mesh, each three vertices with barycentric weights."""

    def __init__(
        self,
        geometry: FaceGeometry,
        corners: Int[np.ndarray, "points 3"],
        weights: Float[np.ndarray, "points 3"],
    ) -> None:
        """``corners`` rendered-vertex indices and ``weights``."""
        rows = (3 * corners[..., None] + np.arange(3)).reshape(-1)
        basis = geometry.basis[rows].reshape(*corners.shape, 3, geometry.basis.shape[1])
        self._basis = np.einsum("mi,mixk->mxk", weights, basis, optimize=True)
        self._mean = np.einsum("mi,mix->mx", weights, geometry.mean[corners])

    def part(self, chosen: Shaped[np.ndarray, " _"]) -> SurfacePoints:
        """Some of the points (indices or a mask)."""
        result = object.__new__(SurfacePoints)
        result._basis, result._mean = self._basis[chosen], self._mean[chosen]
        return result

    def positions(self, state: State) -> Float[np.ndarray, "points 3"]:
        """Where the points are, metres in the camera frame."""
        weights = state.shape_weights
        return (
            self._mean + self._basis[..., : len(weights)] @ weights
        ) @ state.rotation.T + state.translation

    def project(self, state: State) -> Float[np.ndarray, "points 2"]:
        """Where the points show, in pixels."""
        return state.camera.project(self.positions(state))

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "points 2 unknowns"]:
        """Derivative of :meth:`project` by every parameter; only pose, focal and shape
        are not 0.
        """
        points = self.positions(state)
        depth, focal = -points[:, 2], state.camera.focal_px
        x, y = points[:, 0] / depth, points[:, 1] / depth
        by_point = np.zeros((len(points), 2, 3))
        by_point[:, 0, 0], by_point[:, 0, 2] = focal / depth, focal * x / depth
        by_point[:, 1, 1], by_point[:, 1, 2] = -focal / depth, -focal * y / depth
        result = np.zeros((len(points), 2, layout.size))
        arm = np.broadcast_to((points - state.translation)[:, None], by_point.shape)
        pose = layout.slices["pose"].start
        result[:, :, pose : pose + 3] = np.cross(arm, by_point)
        result[:, :, pose + 3 : pose + 6] = by_point
        result[:, :, layout.slices["focal"].start] = np.stack([focal * x, -focal * y], axis=1)
        shape = np.einsum("mcx,mxk->mck", by_point @ state.rotation, self._basis, optimize=True)
        where = layout.shape
        result[:, :, where] = shape[..., : where.stop - where.start]
        return result
