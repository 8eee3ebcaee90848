"""The landmark term: reprojection of the model's landmark points (Garrido et al. 2016)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.fit.contour_lines import ContourLines, contour_lines
from facestage.fit.geometry import FaceGeometry
from facestage.fit.parameters import Layout, State
from facestage.fit.surface_points import SurfacePoints
from facestage.models.landmark_schemes import Scheme, scheme_of

# A point that the file marks as hidden is a guess of whoever made it.
HIDDEN_SIGMA = 3.0
# Cosines of normal and view between which a point turns from one that shows to one that nobody saw, whatever the file
# says, and how far such a guess may be off.
TURNED_AWAY, FACING = -0.25, 0.05
TURNED_SIGMA = 6.0
# Beyond three standard deviations a landmark is more likely wrong than unlucky.
CAUCHY_SCALE = 3.0


@dataclass(frozen=True)
class _Candidates:
    """Every surface point that a landmark of a scheme can be: the m of the table, then those of the outline's lines."""

    points: SurfacePoints
    corners: np.ndarray  # (m, 3) rendered-vertex indices of the table
    weights: np.ndarray  # (m, 3)
    lines: ContourLines | None


@lru_cache(maxsize=4)
def _candidates(geometry: FaceGeometry, scheme: str) -> _Candidates:
    vertices, weights = geometry.model.landmark_vertices(scheme)
    corners, weights = geometry.new_index[vertices], weights.astype(np.float64)
    contour = scheme_of(scheme).contour
    if not len(contour):
        return _Candidates(SurfacePoints(geometry, corners, weights), corners, weights, None)
    lines = contour_lines(geometry, corners[contour], weights[contour])
    points = SurfacePoints(
        geometry, np.concatenate([corners, lines.corners.reshape(-1, 3)]),
        np.concatenate([weights, lines.weights.reshape(-1, 3)]),
    )  # fmt: skip
    return _Candidates(points, corners, weights, lines)


class LandmarkTerm:
    """The landmarks of a photo against a face; :meth:`at` places them on it, in pixels of the working photo."""

    def __init__(self, geometry: FaceGeometry, landmarks: Landmarks, sigma_px: float) -> None:
        """``sigma_px``: standard deviation of a sharp point, such as the corner of an eye, in pixels."""
        self.geometry, self.landmarks = geometry, landmarks
        self.scheme: Scheme = scheme_of(landmarks.scheme)
        self._candidates = _candidates(geometry, landmarks.scheme)
        self.points = np.nan_to_num(landmarks.points)
        sigma = sigma_px * self.scheme.deviation
        sigma[~landmarks.visible] *= HIDDEN_SIGMA
        if landmarks.weights is not None:
            sigma /= np.sqrt(np.maximum(landmarks.weights, 1e-30))
            sigma[landmarks.weights == 0] = np.inf
        sigma[~np.isfinite(landmarks.points).all(1)] = np.inf
        sigma[self.scheme.behind_closed_lids(landmarks.points)] = np.inf
        self.sigma = sigma

    @property
    def observations(self) -> float:
        """How many independent points the landmarks amount to."""
        return self.scheme.share * float(np.isfinite(self.sigma).sum())

    def at(self, state: State) -> PlacedLandmarks:
        """The term around ``state``: which point of the skin each landmark is there, and how well it shows."""
        chosen = np.arange(len(self.points))
        lines = self._candidates.lines
        if lines is not None:
            # Whoever marks a point as hidden did not mark the outline.
            slides = self.landmarks.visible[self.scheme.contour]
            chosen[self.scheme.contour[slides]] = self._outermost(lines, state)[slides]
        sigma = self.sigma * self._turned(state, chosen)
        return PlacedLandmarks(self._candidates.points.part(chosen), self.points, sigma, self.scheme.share)

    def _outermost(self, lines: ContourLines, state: State) -> np.ndarray:
        """(k,) which candidate shows furthest from the axis of the face, in each line."""
        count = lines.corners.shape[1]
        pixels = self._candidates.points.project(state)[len(self.points) :].reshape(-1, count, 2)
        ends = np.concatenate([lines.centre[None], lines.centre + 0.01 * lines.outward])
        ends = state.camera.project(ends @ state.rotation.T + state.translation)
        outward = np.einsum("kcx,kx->kc", pixels, ends[1:] - ends[:1])
        # Of equals the last, which is the landmark itself.
        last = count - 1 - np.nan_to_num(outward)[:, ::-1].argmax(axis=1)
        return len(self.points) + count * np.arange(len(pixels)) + last

    def _turned(self, state: State, chosen: np.ndarray) -> np.ndarray:
        """(m,) factor on the standard deviations: 1 where a point faces the camera, TURNED_SIGMA facing away."""
        corners, weights = self._candidates.corners, self._candidates.weights
        shape = self.geometry.vertices(state.identity, state.expression)
        normals = np.einsum("mi,mix->mx", weights, self.geometry.vertex_normals(shape)[0][corners]) @ state.rotation.T
        points = np.einsum("mi,mix->mx", weights, shape[corners]) @ state.rotation.T + state.translation
        scale = np.linalg.norm(points, axis=1) * np.linalg.norm(normals, axis=1)
        cosine = -np.einsum("mx,mx->m", points, normals) / np.maximum(scale, 1e-20)
        share = np.clip((FACING - cosine) / (FACING - TURNED_AWAY), 0.0, 1.0)
        # The outline shows by definition.
        share[chosen != np.arange(len(chosen))] = 0.0
        return TURNED_SIGMA**share


class PlacedLandmarks:
    """Residuals (2 m,) in standard deviations and their Jacobian, for landmarks on points of the skin."""

    def __init__(self, on_face: SurfacePoints, points: np.ndarray, sigma: np.ndarray, share: float) -> None:
        """``points`` (m, 2) pixels, ``sigma`` (m,) pixels; ``share``: of an independent point that each stands for."""
        self.on_face, self.points, self.sigma, self.share = on_face, points, sigma, share

    def project(self, state: State) -> np.ndarray:
        """(m, 2) pixels of the model's landmarks."""
        return self.on_face.project(state)

    def residuals(self, state: State) -> np.ndarray:
        """(2 m,) standard deviations."""
        return ((self.project(state) - self.points) / self.sigma[:, None]).ravel()

    def robust_weights(self, residuals: np.ndarray) -> np.ndarray:
        """(2 m,) Cauchy weights, one per point, times the share that neighbors leave it."""
        return self.share * np.repeat(1.0 / (1.0 + _squared(residuals) / CAUCHY_SCALE**2), 2)

    def robust_energy(self, state: State) -> float:
        """The Cauchy energy that :meth:`robust_weights` belong to."""
        squared = _squared(self.residuals(state))
        return 0.5 * self.share * CAUCHY_SCALE**2 * float(np.log1p(squared / CAUCHY_SCALE**2).sum())

    def jacobian(self, state: State, layout: Layout) -> np.ndarray:
        """(2 m, size) derivative of :meth:`residuals`."""
        by_pixel = self.on_face.jacobian(state, layout) / self.sigma[:, None, None]
        return by_pixel.reshape(-1, layout.size)


def _squared(residuals: np.ndarray) -> np.ndarray:
    return (residuals.reshape(-1, 2) ** 2).sum(axis=1)
