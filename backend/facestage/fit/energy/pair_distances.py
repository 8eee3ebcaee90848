"""Distances between pairs of landmarks, which the photo knows better than where each point is."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Self

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.robust_residuals import QuadraticResiduals
from facestage.fit.energy.term import Setup, Term
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.surface_points import SurfacePoints


@dataclass(frozen=True, eq=False)
class PairDistances(QuadraticResiduals):
    """Residuals in standard deviations of the distances of pairs, each along a direction of its
    own. The loss is quadratic: they are believed however far off the face still is.
    """

    on_face: SurfacePoints  # the first points of all pairs, then the second ones
    along: Float[np.ndarray, "pairs 2"]  # from second to first, unit over a standard deviation
    apart: Float[np.ndarray, " pairs"]  # in the photo, standard deviations
    share: float
    weight: float = 1.0

    def residuals(self, state: State) -> Float[np.ndarray, " pairs"]:
        """How much further apart the points are than in the photo, in standard deviations."""
        first, second = np.split(self.on_face.project(state), 2)
        return np.einsum("px,px->p", first - second, self.along) - self.apart

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "pairs unknowns"]:
        """Derivative of :meth:`residuals`."""
        first, second = np.split(self.on_face.jacobian(state, layout), 2)
        return np.einsum("pxk,px->pk", first - second, self.along)


class SeenPairs(PairDistances, Term):
    """Pairs that landmarks show whatever the phase."""

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of every phase, where landmarks know the pairs."""
        landmarks = setup.problem.landmarks_at(setup.factor)
        return cls.seen(setup.problem.geometry, landmarks, setup.problem.job.weights.landmarks)

    @classmethod
    @abstractmethod
    def seen(cls, geometry: FaceGeometry, landmarks: Landmarks, weight: float = 1.0) -> Self | None:
        """The pairs that ``landmarks`` show; None where they show none."""


def pairs_on(
    geometry: FaceGeometry, scheme: str, pairs: Int[np.ndarray, "pairs 2"]
) -> SurfacePoints:
    """Where landmarks of ``scheme`` lie on the face: the first of all ``pairs``, then the second
    ones.
    """
    return points_on(geometry, scheme, pairs.T.ravel())


def points_on(
    geometry: FaceGeometry, scheme: str, chosen: Int[np.ndarray, " points"]
) -> SurfacePoints:
    """Where the ``chosen`` landmarks of ``scheme`` lie on the face."""
    vertices, weights = geometry.model.landmark_vertices(scheme)
    return SurfacePoints(
        geometry, geometry.new_index[vertices[chosen]], weights[chosen].astype(np.float64)
    )
