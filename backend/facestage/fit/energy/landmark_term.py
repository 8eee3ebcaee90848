"""The landmark term: reprojection of the model's landmark points (Garrido et al. 2016)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.robust_residuals import RobustResiduals
from facestage.fit.energy.term import Setup, Term
from facestage.fit.face.contour_lines import ContourLines, contour_lines
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.some_normals import NormalsAt
from facestage.fit.face.state import State
from facestage.fit.face.surface_points import SurfacePoints
from facestage.models.anatomy.landmark_schemes import Scheme, scheme_of

# Standard deviation of a landmark as a share of the face's size: one pixel on a face of 120.
LANDMARK_SIGMA_SHARE = 0.0085
# A point that the file marks as hidden is a guess of whoever made it.
HIDDEN_SIGMA = 3.0
# Cosines of normal and view between which a point turns from one that shows to one that nobody saw,
# whatever the file says, and how far such a guess may be off: on pictures of known faces detections
# are two to three times worse there.
TURNED_AWAY, FACING = -0.25, 0.05
TURNED_SIGMA = 4.0
# Cosines between which the outline is where the face ends in the picture, not on a cheek that faces
# the camera.
GRAZING, FRONTAL = 0.3, 0.5


@dataclass(frozen=True)
class _Candidates:
    """Every surface point that a landmark of a scheme can be: the m of the table, then those of the
    outline's lines.
    """

    points: SurfacePoints
    weights: Float[np.ndarray, "candidates 3"]  # barycentric
    lines: ContourLines | None
    normals: NormalsAt  # of their triangles' corners
    corner: Int[np.ndarray, "candidates 3"]  # each point's three among these


@lru_cache(maxsize=4)
def _candidates(geometry: FaceGeometry, scheme: str) -> _Candidates:
    vertices, weights = geometry.model.landmark_vertices(scheme)
    corners, weights = geometry.new_index[vertices], weights.astype(np.float64)
    contour = scheme_of(scheme).contour
    lines = None
    if scheme_of(scheme).slides:
        lines = contour_lines(geometry, corners[contour], weights[contour])
        corners = np.concatenate([corners, lines.corners.reshape(-1, 3)])
        weights = np.concatenate([weights, lines.weights.reshape(-1, 3)])
    some, corner = np.unique(corners, return_inverse=True)
    points = SurfacePoints(geometry, corners, weights)
    normals = NormalsAt.of(geometry, some)
    return _Candidates(points, weights, lines, normals, corner.reshape(-1, 3))


@dataclass(frozen=True, eq=False)
class LandmarkTerm(Term):
    """The landmarks of a photo against a face; :meth:`at` places them on it, in pixels of the
    working photo.
    """

    words: ClassVar = {"landmarks": "Landmarks"}

    geometry: FaceGeometry
    landmarks: Landmarks
    sigma_px: float  # standard deviation of a sharp point, such as the corner of an eye
    weight: float = 1.0

    @classmethod
    def of(cls, setup: Setup) -> Self:
        """Of every phase."""
        problem, factor = setup.problem, setup.factor
        sigma = LANDMARK_SIGMA_SHARE * problem.face_size_px * factor
        weight = problem.job.weights.landmarks
        return cls(problem.geometry, problem.landmarks_at(factor), sigma, weight)

    @cached_property
    def scheme(self) -> Scheme:
        """What the landmarks stand for."""
        return scheme_of(self.landmarks.scheme)

    @cached_property
    def points(self) -> Float[np.ndarray, "landmarks 2"]:
        """The landmarks in pixels, 0 where unknown."""
        return np.nan_to_num(self.landmarks.points)

    @cached_property
    def sigma(self) -> Float[np.ndarray, " landmarks"]:
        """The standard deviation of each landmark in pixels; infinite where it says nothing."""
        landmarks = self.landmarks
        sigma = self.sigma_px * self.scheme.deviation
        sigma[~landmarks.visible] *= HIDDEN_SIGMA
        if landmarks.weights is not None:
            sigma /= np.sqrt(np.maximum(landmarks.weights, 1e-30))
            sigma[landmarks.weights == 0] = np.inf
        sigma[~np.isfinite(landmarks.points).all(1)] = np.inf
        sigma[self.scheme.behind_closed_lids(landmarks.points)] = np.inf
        return np.asarray(sigma)

    @cached_property
    def _candidates(self) -> _Candidates:
        return _candidates(self.geometry, self.landmarks.scheme)

    @property
    def observations(self) -> float:
        """How many independent points the landmarks amount to."""
        return float(self.scheme.share[np.isfinite(self.sigma)].sum())

    def at(self, state: State, evaluation: Evaluation | None = None) -> PlacedLandmarks:
        """The term around ``state``: which point of the skin each landmark is there, and how well
        it shows.
        """
        contour, lines = self.scheme.contour, self._candidates.lines
        chosen = np.arange(len(self.points))
        if lines is not None:
            # Whoever marks a point as hidden did not mark the outline.
            chosen[contour] = np.where(
                self.landmarks.visible[contour], self._outermost(lines, state), contour
            )
        on_face = self._candidates.points.part(chosen)
        cosine = self._cosine(state, chosen, on_face)
        share = np.clip((FACING - cosine) / (FACING - TURNED_AWAY), 0.0, 1.0)
        # What slid to the outline shows.
        share[chosen != np.arange(len(chosen))] = 0.0
        whitening = np.eye(2) / (self.sigma * TURNED_SIGMA**share)[:, None, None]
        grazing = np.clip((FRONTAL - cosine[contour]) / (FRONTAL - GRAZING), 0.0, 1.0)
        tangent = _tangents(on_face.project(state)[contour])
        along = tangent[:, :, None] * tangent[:, None]
        across = (np.eye(2) - along) / (self.scheme.across**grazing)[:, None, None]
        whitening[contour] = (
            across + along / (self.scheme.along**grazing)[:, None, None]
        ) @ whitening[contour]
        return PlacedLandmarks(on_face, self.points, whitening, self.scheme.share, self.weight)

    def _outermost(self, lines: ContourLines, state: State) -> Int[np.ndarray, " lines"]:
        """Which candidate shows furthest from the axis of the face, in each line; itself where
        no cheek shows.
        """
        count = lines.corners.shape[1]
        pixels = self._candidates.points.project(state)[len(self.points) :].reshape(-1, count, 2)
        ends = np.concatenate([lines.centre[None], lines.centre + 0.01 * lines.outward])
        ends = state.camera.project(ends @ state.rotation.T + state.translation)
        outward = np.einsum("kcx,kx->kc", pixels, ends[1:] - ends[:1])
        # Of equals the last, which is the landmark itself.
        last = count - 1 - np.nan_to_num(outward)[:, ::-1].argmax(axis=1)
        # Furthest out at the start of the line: what is seen there is nose or mouth, and the cheek
        # is behind it.
        slides = (last > 0) & (last < count - 1)
        return np.where(
            slides, len(self.points) + count * np.arange(len(pixels)) + last, self.scheme.contour
        )

    def _cosine(
        self, state: State, chosen: Int[np.ndarray, " landmarks"], on_face: SurfacePoints
    ) -> Float[np.ndarray, " landmarks"]:
        """The cosine between the normal of the ``chosen`` candidates, which are these points
        ``on_face``, and the view: 1 towards the camera.
        """
        weights = self._candidates.weights[chosen]
        normals = self._candidates.normals.at(state.shape_weights)[self._candidates.corner[chosen]]
        normals = np.einsum("mi,mix->mx", weights, normals) @ state.rotation.T
        points = on_face.positions(state)
        scale = np.linalg.norm(points, axis=1) * np.linalg.norm(normals, axis=1)
        return -np.einsum("mx,mx->m", points, normals) / np.maximum(scale, 1e-20)


def _tangents(line: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
    """Unit directions of a polyline at its points."""
    step = np.gradient(np.nan_to_num(line), axis=0)
    length = np.linalg.norm(step, axis=1, keepdims=True)
    return np.where(length > 0, step / np.maximum(length, 1e-30), [1.0, 0.0])


def landmark_pixels(
    geometry: FaceGeometry, landmarks: Landmarks, state: State
) -> Float[np.ndarray, "landmarks 2"]:
    """Where the landmarks of a photo lie on the face at ``state``, those of the outline on
    the outline.
    """
    return LandmarkTerm(geometry, landmarks, 1.0).at(state).project(state)


@dataclass(frozen=True, eq=False)
class PlacedLandmarks(RobustResiduals):
    """Residuals in standard deviations and their Jacobian, for landmarks on points of the
    skin.
    """

    name: ClassVar = "landmarks"
    components: ClassVar = 2

    on_face: SurfacePoints
    points: Float[np.ndarray, "landmarks 2"]  # pixels
    whitening: Float[np.ndarray, "landmarks 2 2"]  # takes pixels to standard deviations
    share: Float[np.ndarray, " landmarks"]  # of an independent point that each stands for
    weight: float = 1.0

    def project(self, state: State) -> Float[np.ndarray, "landmarks 2"]:
        """The model's landmarks in pixels."""
        return self.on_face.project(state)

    def residuals(self, state: State) -> Float[np.ndarray, " residuals"]:
        """The residuals, in standard deviations."""
        return np.einsum("mxy,my->mx", self.whitening, self.project(state) - self.points).ravel()

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "residuals unknowns"]:
        """Derivative of :meth:`residuals`."""
        return (self.whitening @ self.on_face.jacobian(state, layout)).reshape(-1, layout.size)
