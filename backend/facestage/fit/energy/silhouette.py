"""The silhouette term: the face's outer edge in the photo pulls on the edge of the mesh.

At the outline a pixel's coverage is what changes, and the shading's derivative does not see it.
Across each point of the mesh's outline the photo's profile between face and background says how far
the true edge lies, to a part of a pixel: the coverage integrated along the normal (the boundary
term of a renderer's derivative, Li et al. 2018, with the photo's own background on the other side).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.fit.energy.edge_search import EdgeSearch
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.outline import Outline, OutlineFinder
from facestage.fit.energy.pair_distances import points_on
from facestage.fit.energy.robust_residuals import RobustResiduals
from facestage.fit.energy.term import Setup, Term
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.surface_points import SurfacePoints
from facestage.fit.face.unknowns import SURFACE
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.photo import Photo
from facestage.models.anatomy.landmark_schemes import scheme_of

# Standard deviation of an edge, as a share of the face's size, but at least a pixel; of one further
# off, as a share of its distance.
SIGMA_SHARE, SIGMA_PX_MIN, FAR_SIGMA = 0.012, 1.0, 1 / 3
# The stretch of outline that counts as one observation, a share of the face's size.
CORRELATION_SHARE = 0.04
# An edge is believed where those around it agree: shares of the face's size.
AROUND_SHARE, AGREE_SHARE, AGREE_PX_MIN = 0.08, 0.015, 1.0
POINTS_MIN = 8


@dataclass(frozen=True, eq=False)
class Silhouette(RobustResiduals):
    """Outline points of one state and where the photo has the edge.

    Residuals are standard deviations.
    """

    name: ClassVar = "silhouette"

    points: SurfacePoints
    normals: Float[np.ndarray, "points 2"]  # unit, outward in the photo
    targets: Float[np.ndarray, "points 2"]  # pixels on the photo's edge
    sigma: Float[np.ndarray, " points"]  # pixels
    share: float  # of an observation that one point counts for: neighbours say the same
    weight: float = 1.0

    def residuals(self, state: State) -> Float[np.ndarray, " points"]:
        """Signed distances across the edge; the outline is free to slide along it."""
        off = self.points.project(state) - self.targets
        return np.einsum("mc,mc->m", off, self.normals) / self.sigma

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "points unknowns"]:
        """Derivative of :meth:`residuals`."""
        by_pixel = self.points.jacobian(state, layout)
        return np.einsum("mc,mck->mk", self.normals / self.sigma[:, None], by_pixel)


@dataclass(frozen=True, eq=False)
class SilhouetteTerm(Term):
    """Finds the outline of a state and its place in the photo."""

    words: ClassVar = {"silhouette": "Outline of the face"}

    forward: ForwardModel
    photo: Photo
    face_px: float  # the face's size in pixels of ``photo``
    weight: float = 1.0
    mouth: SurfacePoints | None = None  # its lips, where landmarks know them

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of phases that move the shape: in others the outline is as it is."""
        if setup.photo is None or not setup.moves(SURFACE):
            return None
        problem = setup.problem
        scheme = problem.landmarks.scheme
        mouth = points_on(problem.geometry, scheme, scheme_of(scheme).lips)
        face_px = setup.factor * problem.face_size_px
        return cls(setup.forward, setup.photo, face_px, problem.job.weights.photo, mouth)

    @cached_property
    def _finder(self) -> OutlineFinder:
        return OutlineFinder(self.forward)

    @cached_property
    def _search(self) -> EdgeSearch:
        return EdgeSearch(self.photo, self.face_px)

    def at(self, state: State, evaluation: Evaluation | None = None) -> Silhouette | None:
        """The outline at ``state``; None where too little of it shows before another background."""
        outline = self._finder.at(state)
        if len(outline.edges) < POINTS_MIN:
            return None
        further = self._is_jaw(state, outline)
        offset = self._search.nearest(outline.middle, outline.normal, further)
        found = np.flatnonzero(np.isfinite(offset))
        found = found[self._agreed(outline.middle[found], offset[found])]
        if len(found) < POINTS_MIN:
            return None
        outline, offset = outline.part(found), offset[found]
        edges = outline.edges
        corners = np.concatenate([edges, edges[:, 1:]], axis=1)
        points = SurfacePoints(
            self.forward.geometry, corners, np.broadcast_to([0.5, 0.5, 0.0], corners.shape)
        )
        targets = outline.middle + offset[:, None] * outline.normal
        sigma = max(SIGMA_SHARE * self.face_px, SIGMA_PX_MIN)
        sigmas = np.maximum(sigma, FAR_SIGMA * np.abs(offset))
        share = min(1.0 / (CORRELATION_SHARE * self.face_px), 1.0)
        return Silhouette(points, outline.normal, targets, sigmas, share, self.weight)

    def _is_jaw(self, state: State, outline: Outline) -> Bool[np.ndarray, " places"]:
        """Whether a place lies below the mouth: beside it and above, skin further out may be an
        ear's.
        """
        if self.mouth is None:
            return np.zeros(len(outline.middle), bool)
        down = state.translation - 0.01 * state.rotation[:, 1]
        ends = state.camera.project(np.stack([state.translation, down]))
        mouth = self.mouth.project(state).mean(axis=0)
        return np.asarray((outline.middle - mouth) @ (ends[1] - ends[0]) > 0)

    def _agreed(
        self, places: Float[np.ndarray, "places 2"], offset: Float[np.ndarray, " places"]
    ) -> Bool[np.ndarray, " places"]:
        """Whether an edge is about as far off as most of those around it."""
        apart = np.linalg.norm(places[:, None] - places, axis=2)
        around = np.where(apart < AROUND_SHARE * self.face_px, offset, np.nan)
        room = max(AGREE_SHARE * self.face_px, AGREE_PX_MIN)
        return np.abs(offset - np.nanmedian(around, axis=1)) < room
