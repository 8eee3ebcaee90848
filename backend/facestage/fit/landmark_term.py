"""The landmark term: reprojection of the model's landmark points (Garrido et al. 2016)."""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.fit.geometry import FaceGeometry
from facestage.fit.parameters import Layout, State

# The jaw's landmarks sit where the annotator saw the outline, not on fixed vertices; a hidden point
# is a guess of whoever made the file.
CONTOUR_SIGMA, HIDDEN_SIGMA = 1.5, 3.0
CONTOUR_POINTS = {"ibug68": 17}
# Beyond three standard deviations a landmark is more likely wrong than unlucky.
CAUCHY_SCALE = 3.0


class LandmarkTerm:
    """Residuals (2 m,) in standard deviations and their Jacobian; pixels of the working photo."""

    def __init__(self, geometry: FaceGeometry, landmarks: Landmarks, sigma_px: float) -> None:
        vertices, weights = geometry.model.landmark_vertices(landmarks.scheme)
        self.corners = geometry.new_index[vertices]  # (m, 3)
        self.weights = weights.astype(np.float64)
        rows = (3 * self.corners[..., None] + np.arange(3)).reshape(-1)
        basis = geometry.basis[rows].reshape(*self.corners.shape, 3, geometry.basis.shape[1])
        self.basis = np.einsum("mi,mixk->mxk", self.weights, basis)
        self.mean = np.einsum("mi,mix->mx", self.weights, geometry.mean[self.corners])
        self.points = np.nan_to_num(landmarks.points)
        sigma = np.full(len(self.points), sigma_px)
        sigma[: CONTOUR_POINTS.get(landmarks.scheme, 0)] *= CONTOUR_SIGMA
        sigma[~landmarks.visible] *= HIDDEN_SIGMA
        sigma[~np.isfinite(landmarks.points).all(1)] = np.inf
        self.sigma = sigma
        self.identity_count = geometry.identity_count

    def _positions(self, state: State) -> np.ndarray:
        weights = np.concatenate([state.identity, state.expression])
        return (self.mean + self.basis @ weights) @ state.rotation.T + state.translation

    def project(self, state: State) -> np.ndarray:
        """(m, 2) pixels of the model's landmarks."""
        return state.camera.project(self._positions(state))

    def residuals(self, state: State) -> np.ndarray:
        """(2 m,) standard deviations."""
        return ((self.project(state) - self.points) / self.sigma[:, None]).ravel()

    def robust_weights(self, residuals: np.ndarray) -> np.ndarray:
        """(2 m,) Cauchy weights, one per point."""
        squared = (residuals.reshape(-1, 2) ** 2).sum(1)
        return np.repeat(1.0 / (1.0 + squared / CAUCHY_SCALE**2), 2)

    def jacobian(self, state: State, layout: Layout) -> np.ndarray:
        """(2 m, size) derivative of :meth:`residuals`."""
        points = self._positions(state)
        depth, focal = -points[:, 2], state.camera.focal_px
        x, y = points[:, 0] / depth, points[:, 1] / depth
        by_point = np.zeros((len(points), 2, 3))
        by_point[:, 0, 0], by_point[:, 0, 2] = focal / depth, focal * x / depth
        by_point[:, 1, 1], by_point[:, 1, 2] = -focal / depth, -focal * y / depth
        by_point /= self.sigma[:, None, None]
        result = np.zeros((len(points), 2, layout.size))
        arm = np.broadcast_to((points - state.translation)[:, None], by_point.shape)
        pose = layout.slices["pose"].start
        result[:, :, pose : pose + 3] = np.cross(arm, by_point)
        result[:, :, pose + 3 : pose + 6] = by_point
        by_focal = np.stack([focal * x, -focal * y], axis=1) / self.sigma[:, None]
        result[:, :, layout.slices["focal"].start] = by_focal
        shape = np.einsum("mcx,mxk->mck", by_point @ state.rotation, self.basis, optimize=True)
        result[:, :, layout.slices["identity"]] = shape[..., : self.identity_count]
        result[:, :, layout.slices["expression"]] = shape[..., self.identity_count :]
        return result.reshape(-1, layout.size)
