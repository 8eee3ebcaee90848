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
from scipy.ndimage import map_coordinates

from facestage.contract.arrays import Bool, Float, Int
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.robust_residuals import RobustResiduals
from facestage.fit.energy.term import Setup, Term
from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.surface_points import SurfacePoints
from facestage.fit.face.unknowns import SURFACE
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.given.photo import Photo

# How far to either side the edge is looked for, its standard deviation, and the stretch of outline
# that counts as one observation: shares of the face's size.
REACH_SHARE, SIGMA_SHARE, CORRELATION_SHARE = 0.025, 0.006, 0.04
STEP_PX = 0.5
# Face and background must differ by this share of the brighter, and the profile be a step up to
# this mean error.
CONTRAST_MIN, STEP_ERROR_MAX = 0.35, 0.15
# How much of the profile's inner end must have the face's own color: hair in front of a cheek is
# not its outline.
SKIN_INSIDE_MIN = 0.6
FLOOR_SHARE = 0.1
# A point of the outline is seen when the ray just inside hits the face this close to it, metres.
DEPTH_TOLERANCE = 0.01
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
    sigma: float  # pixels
    share: float  # of an observation that one point counts for: neighbours say the same
    weight: float = 1.0

    def residuals(self, state: State) -> Float[np.ndarray, " points"]:
        """Signed distances across the edge; the outline is free to slide along it."""
        off = self.points.project(state) - self.targets
        return np.einsum("mc,mc->m", off, self.normals) / self.sigma

    def jacobian(self, state: State, layout: Layout) -> Float[np.ndarray, "points unknowns"]:
        """Derivative of :meth:`residuals`."""
        by_pixel = self.points.jacobian(state, layout)
        return np.einsum("mc,mck->mk", self.normals, by_pixel) / self.sigma


@dataclass(frozen=True, eq=False)
class SilhouetteTerm(Term):
    """Finds the outline of a state and its place in the photo."""

    words: ClassVar = {"silhouette": "Outline of the face"}

    forward: ForwardModel
    photo: Photo
    face_px: float  # the face's size in pixels of ``photo``
    weight: float = 1.0

    @classmethod
    def of(cls, setup: Setup) -> Self | None:
        """Of phases that move the shape: in others the outline is as it is."""
        if setup.photo is None or not setup.moves(SURFACE):
            return None
        face_px = setup.factor * setup.problem.face_size_px
        return cls(setup.forward, setup.photo, face_px, setup.problem.job.weights.photo)

    @cached_property
    def _mesh(self) -> tuple[Int[np.ndarray, "edges 2"], Int[np.ndarray, "edges 2"]]:
        geometry = self.forward.geometry
        return _mesh_edges(geometry.triangles, geometry.fitted)

    def at(self, state: State, evaluation: Evaluation | None = None) -> Silhouette | None:
        """The outline at ``state``; None where too little of it shows before another background."""
        edges, opposite = self._outline(state)
        if len(edges) < POINTS_MIN:
            return None
        vertices = self.forward.pose(state)[1]
        pixels = state.camera.project(vertices)
        middle = 0.5 * (pixels[edges[:, 0]] + pixels[edges[:, 1]])
        along = pixels[edges[:, 1]] - pixels[edges[:, 0]]
        length = np.linalg.norm(along, axis=1)
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.maximum(length, 1e-9)[:, None]
        normal *= -np.sign(np.einsum("ec,ec->e", normal, pixels[opposite] - middle))[:, None]
        keep = (length > 1e-6) & np.isfinite(middle).all(axis=1)
        # One point for each pixel that the outline crosses.
        _, first = np.unique(np.floor(middle[keep]).astype(int), axis=0, return_index=True)
        chosen = np.flatnonzero(keep)[first]
        chosen = chosen[self._seen(state, vertices, edges[chosen], middle[chosen], normal[chosen])]
        if len(chosen) < POINTS_MIN:
            return None
        offset = self._edge_offset(middle[chosen], normal[chosen])
        found = np.isfinite(offset)
        if found.sum() < POINTS_MIN:
            return None
        chosen, offset = chosen[found], offset[found]
        corners = np.stack([edges[chosen, 0], edges[chosen, 1], edges[chosen, 1]], axis=1)
        points = SurfacePoints(
            self.forward.geometry, corners, np.broadcast_to([0.5, 0.5, 0.0], corners.shape)
        )
        targets = middle[chosen] + offset[:, None] * normal[chosen]
        sigma = max(SIGMA_SHARE * self.face_px, STEP_PX)
        share = min(1.0 / (CORRELATION_SHARE * self.face_px), 1.0)
        return Silhouette(points, normal[chosen], targets, sigma, share, self.weight)

    def _outline(
        self, state: State
    ) -> tuple[Int[np.ndarray, "edges 2"], Int[np.ndarray, " edges"]]:
        """Edges between a fitted triangle that faces the camera and one that does not, and
        the third vertex.
        """
        vertices = self.forward.pose(state)[1]
        triangles = self.forward.geometry.triangles
        facing = (
            np.einsum(
                "tx,tx->t", self.forward.geometry.face_normals(vertices), vertices[triangles[:, 0]]
            )
            < 0
        )
        edges, sides = self._mesh
        front = facing[sides]
        turn = front[:, 0] != front[:, 1]
        edges, sides, front = edges[turn], sides[turn], front[turn]
        near = np.where(front[:, 0], sides[:, 0], sides[:, 1])
        fitted = self.forward.geometry.fitted[near]
        edges, near = edges[fitted], near[fitted]
        third = triangles[near]
        other = (third != edges[:, :1]) & (third != edges[:, 1:])
        return edges, third[np.arange(len(third)), other.argmax(axis=1)]

    def _seen(
        self,
        state: State,
        vertices: Float[np.ndarray, "vertices 3"],
        edges: Int[np.ndarray, "edges 2"],
        middle: Float[np.ndarray, "edges 2"],
        normal: Float[np.ndarray, "edges 2"],
    ) -> Bool[np.ndarray, " edges"]:
        """Nothing of the head lies just outside, and just inside lies the face
        itself.
        """
        outside = self.forward.hits(state, middle + 1.5 * normal).triangle < 0
        hits = self.forward.hits(state, middle - normal)
        inside = (hits.triangle >= 0) & self.forward.geometry.fitted[hits.triangle]
        depth = -vertices[self.forward.geometry.triangles[hits.triangle]][..., 2]
        depth = np.einsum("mi,mi->m", hits.barycentric, depth)
        edge_depth = -vertices[edges][..., 2].mean(axis=1)
        return outside & inside & (np.abs(depth - edge_depth) < DEPTH_TOLERANCE)

    def _edge_offset(
        self, middle: Float[np.ndarray, "edges 2"], normal: Float[np.ndarray, "edges 2"]
    ) -> Float[np.ndarray, " edges"]:
        """Pixels along the outward normal to the photo's edge; NaN where the photo shows
        none.
        """
        reach = max(REACH_SHARE * self.face_px, 2.0)
        count = int(np.ceil(reach / STEP_PX))
        reach = count * STEP_PX
        steps = np.arange(-2 * count, 2 * count + 1) * STEP_PX
        at = middle[:, None] + steps[:, None] * normal[:, None]  # (m, s, 2)
        height, width = self.photo.usable.shape
        place = [at[..., 1] - 0.5, at[..., 0] - 0.5]
        color = np.stack(
            [
                map_coordinates(self.photo.color[..., channel], place, order=1)
                for channel in range(3)
            ],
            axis=-1,
        )
        usable = map_coordinates(self.photo.usable.astype(np.uint8), place, order=0) > 0
        skin = map_coordinates(self.photo.skin, place, order=1)
        inner, outer, window = steps <= -reach, steps >= reach, np.abs(steps) < reach
        face, back = color[:, inner].mean(axis=1), color[:, outer].mean(axis=1)
        difference = face - back
        floor = (
            FLOOR_SHARE * float(self.photo.color[self.photo.usable].mean())
            if self.photo.usable.any()
            else 1.0
        )
        brighter = np.maximum(np.linalg.norm(face, axis=1), np.linalg.norm(back, axis=1))
        contrast = np.linalg.norm(difference, axis=1) / (brighter + floor)
        coverage = np.einsum("msc,mc->ms", color - back[:, None], difference)
        coverage = np.clip(coverage / np.maximum((difference**2).sum(axis=1), 1e-20)[:, None], 0, 1)
        offset = -reach + STEP_PX * (coverage[:, window].sum(axis=1) + 0.5)
        step = np.clip(0.5 - (steps[window] - offset[:, None]), 0, 1)
        error = np.abs(coverage[:, window] - step).mean(axis=1)
        good = usable.all(axis=1) & (contrast > CONTRAST_MIN) & (error < STEP_ERROR_MAX)
        good &= skin[:, inner].mean(axis=1) > SKIN_INSIDE_MIN
        good &= ((at > 0) & (at < [width, height])).all(axis=(1, 2))
        return np.where(good, offset, np.nan)


def _mesh_edges(
    triangles: Int[np.ndarray, "triangles 3"], fitted: Bool[np.ndarray, " triangles"]
) -> tuple[Int[np.ndarray, "edges 2"], Int[np.ndarray, "edges 2"]]:
    """Edges that two triangles share, one of them ``fitted`` at least, and these triangles."""
    pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, owner = pairs[order], owner[order]
    same = np.flatnonzero((pairs[1:] == pairs[:-1]).all(axis=1))
    edges, sides = pairs[same], np.stack([owner[same], owner[same + 1]], axis=1)
    keep = fitted[sides].any(axis=1)
    return edges[keep], sides[keep]
