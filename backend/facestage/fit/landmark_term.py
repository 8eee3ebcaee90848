"""The landmark term: reprojection of the model's landmark points (Garrido et al. 2016)."""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.fit.geometry import FaceGeometry
from facestage.fit.parameters import Layout, State
from facestage.fit.surface_points import SurfacePoints

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
        self.on_face = SurfacePoints(geometry, geometry.new_index[vertices], weights.astype(np.float64))
        self.points = np.nan_to_num(landmarks.points)
        sigma = np.full(len(self.points), sigma_px)
        sigma[: CONTOUR_POINTS.get(landmarks.scheme, 0)] *= CONTOUR_SIGMA
        sigma[~landmarks.visible] *= HIDDEN_SIGMA
        sigma[~np.isfinite(landmarks.points).all(1)] = np.inf
        self.sigma = sigma

    def project(self, state: State) -> np.ndarray:
        """(m, 2) pixels of the model's landmarks."""
        return self.on_face.project(state)

    def residuals(self, state: State) -> np.ndarray:
        """(2 m,) standard deviations."""
        return ((self.project(state) - self.points) / self.sigma[:, None]).ravel()

    def robust_weights(self, residuals: np.ndarray) -> np.ndarray:
        """(2 m,) Cauchy weights, one per point."""
        squared = (residuals.reshape(-1, 2) ** 2).sum(1)
        return np.repeat(1.0 / (1.0 + squared / CAUCHY_SCALE**2), 2)

    def jacobian(self, state: State, layout: Layout) -> np.ndarray:
        """(2 m, size) derivative of :meth:`residuals`."""
        by_pixel = self.on_face.jacobian(state, layout) / self.sigma[:, None, None]
        return by_pixel.reshape(-1, layout.size)
