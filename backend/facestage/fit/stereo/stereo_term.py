"""The stereo term: skin that two photos show at matched places must be one place of the face.

A match says that the skin which photo A sees at pixel p shows at q in photo B. With the triangle
that p's ray meets, its residual is where B shows that point of it, less q. When the face moves by
the parameters x the ray stays, so the point slides over the skin by as much as A would else show it
move: dr = (dB/dx - C dA/dx) dx, C how B's pixel moves with A's on that triangle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.fit.energy.robust_residuals import CAUCHY_SCALE
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.joint_layout import JointLayout
from facestage.fit.face.unknowns import SURFACE
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.stereo.joint_term import JointTerm, JointWeighed, States
from facestage.fit.stereo.matches import Matches
from facestage.fit.stereo.seen_points import (
    SeenPoints,
    between_photos,
    camera_vertices,
    jacobian_of,
    shown,
)

NAME = "stereo"


@dataclass(frozen=True, eq=False)
class Pair:
    """The matches of two photos, by their places among the photos of a phase."""

    first: int
    second: int
    forward: ForwardModel  # of the first photo
    matches: Matches


@dataclass(frozen=True, eq=False)
class StereoTerm(JointTerm):
    """All matches of a phase, in pixels of its size."""

    words: ClassVar = {NAME: "Same skin in two photos"}

    pairs: tuple[Pair, ...]
    # Standard deviation in pixels, by photo, of what no shape of the model can place better, and
    # of how far the matches may be misled by light.
    floors: tuple[float, ...]
    weight: float = 1.0

    def weighed(self, states: States) -> WeighedStereo:
        """With the triangles that the first photos see at ``states``, and robust weights."""
        hits = self._hits(states)
        placed = [_placed(*one, self.floors) for one in zip(self.pairs, hits, strict=True)]
        weighed = [one.robust(states, self.weight) for one in placed if one is not None]
        return WeighedStereo(tuple(weighed), len(states))

    def _hits(self, states: States) -> list[Int[np.ndarray, " points"]]:
        """By pair, the triangle that each pixel of its first photo sees, -1 for none; a photo's
        face is laid out once for all its pairs.
        """
        result: dict[int, np.ndarray] = {}
        for first in {pair.first for pair in self.pairs}:
            places = [place for place, pair in enumerate(self.pairs) if pair.first == first]
            pixels = [self.pairs[place].matches.pixels for place in places]
            forward = self.pairs[places[0]].forward
            found = forward.hits(states[first], np.concatenate(pixels)).triangle
            ends = np.cumsum([len(one) for one in pixels])[:-1]
            result |= dict(zip(places, np.split(found, ends), strict=True))
        return [result[place] for place in range(len(self.pairs))]


@dataclass(frozen=True, eq=False)
class PlacedPair:
    """The matches of two photos whose first pixels see skin; residuals are standard deviations."""

    first: int
    second: int
    seen: SeenPoints
    targets: Float[np.ndarray, "points 2"]
    whitening: Float[np.ndarray, "points 2 2"]  # takes the second photo's pixels to deviations
    share: float

    @property
    def geometry(self) -> FaceGeometry:
        """The face's."""
        return self.seen.geometry

    def residuals(self, states: States) -> Float[np.ndarray, "points 2"]:
        """Where the second photo shows what the first one sees, less where it was found."""
        first, second = states[self.first], states[self.second]
        weights = self.seen.weights(first, camera_vertices(self.geometry, first))
        there = camera_vertices(self.geometry, second)
        off = shown(there, self.seen.corners, weights, second) - self.targets
        return np.einsum("pxy,py->px", self.whitening, off)

    def jacobian(
        self, states: States, layout: JointLayout
    ) -> tuple[Float[np.ndarray, "points 2 moving"], np.ndarray]:
        """Derivative of :meth:`residuals` by the parameters of both photos' shape, and which of the
        joint vector these are, the shared ones once.
        """
        first, second = states[self.first], states[self.second]
        meshes = camera_vertices(self.geometry, first), camera_vertices(self.geometry, second)
        weights = self.seen.weights(first, meshes[0])
        points = self.seen.at(weights)
        across = between_photos(meshes, self.seen.corners, weights, (first, second))
        parts = (self.first, -across), (self.second, np.eye(2))
        moving = [np.flatnonzero(layout.layouts[index].mask(SURFACE)) for index, _ in parts]
        joint = [layout.columns[index][own] for (index, _), own in zip(parts, moving, strict=True)]
        columns = np.unique(np.concatenate(joint))
        result = np.zeros((len(points.positions(first)), 2, len(columns)))
        for (index, turn), own, where in zip(parts, moving, joint, strict=True):
            by_own = jacobian_of(points, states[index], layout.layouts[index], own)
            result[..., np.searchsorted(columns, where)] += turn @ by_own
        return self.whitening @ result, columns

    def robust(self, states: States, weight: float) -> WeighedPair:
        """With Cauchy weights: where light misleads a match it is wrong, not unlucky."""
        residuals = self.residuals(states)
        squared = (residuals**2).sum(axis=1) / CAUCHY_SCALE**2
        weights = weight * self.share / (1.0 + squared)
        return WeighedPair(self, states, residuals, weights)


@dataclass(frozen=True, eq=False)
class WeighedPair:
    """A pair around the photos' states with frozen weights."""

    placed: PlacedPair
    states: States
    residuals: Float[np.ndarray, "points 2"]
    weights: Float[np.ndarray, " points"]

    def energy(self, residuals: Float[np.ndarray, "points 2"]) -> float:
        """Half the weighted sum of squares."""
        return 0.5 * float(self.weights @ (residuals**2).sum(axis=1))

    def add_to(self, hessian: np.ndarray, gradient: np.ndarray, layout: JointLayout) -> None:
        """By the exact Jacobian."""
        jacobian, columns = self.placed.jacobian(self.states, layout)
        flat = jacobian.reshape(-1, len(columns))
        weighted = flat * np.repeat(self.weights, 2)[:, None]
        hessian[np.ix_(columns, columns)] += flat.T @ weighted
        gradient[columns] += weighted.T @ self.residuals.ravel()


@dataclass(frozen=True, eq=False)
class WeighedStereo(JointWeighed):
    """All pairs around the photos' states."""

    pairs: tuple[WeighedPair, ...]
    photos: int

    @property
    def energies(self) -> tuple[dict[str, float], ...]:
        """Half a pair's energy for each of its photos."""
        result = [0.0] * self.photos
        for pair in self.pairs:
            for index in (pair.placed.first, pair.placed.second):
                result[index] += 0.5 * pair.energy(pair.residuals)
        return tuple({NAME: energy} for energy in result)

    def add_to(self, hessian: np.ndarray, gradient: np.ndarray, layout: JointLayout) -> None:
        """Pair by pair."""
        for pair in self.pairs:
            pair.add_to(hessian, gradient, layout)

    def decrease(self, states: States) -> float:
        """A face behind the camera has no residuals."""
        total = 0.0
        for pair in self.pairs:
            residuals = pair.placed.residuals(states)
            if not np.isfinite(residuals).all():
                return -np.inf
            total += pair.energy(pair.residuals) - pair.energy(residuals)
        return total


def _placed(
    pair: Pair, triangles: Int[np.ndarray, " points"], floors: Sequence[float]
) -> PlacedPair | None:
    """A pair with the ``triangles`` that the first photo's pixels see; None where that is no
    skin.
    """
    matches, geometry = pair.matches, pair.forward.geometry
    met = triangles >= 0
    met[met] = geometry.fitted[triangles[met]]
    if not met.any():
        return None
    seen = SeenPoints(geometry, matches.pixels[met], geometry.triangles[triangles[met]])
    covariance = matches.covariance[met] + floors[pair.second] ** 2 * np.eye(2)
    whitening = np.linalg.inv(np.linalg.cholesky(covariance))
    return PlacedPair(pair.first, pair.second, seen, matches.targets[met], whitening, matches.share)
