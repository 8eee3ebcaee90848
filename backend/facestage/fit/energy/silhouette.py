"""The silhouette term: the face's outer edge in the photo pulls on the edge of the mesh.

At the outline a pixel's coverage is what changes, and the shading's derivative does not see it.
Across each point of the mesh's outline the photo's profile between face and background says how far
the true edge lies, to a part of a
pixel: the coverage integrated along the normal (the boundary term of a renderer's derivative, Li et
al. 2018, with the photo's own background on the other side).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from facestage.fit.face.layout import Layout
from facestage.fit.face.state import State
from facestage.fit.face.surface_points import SurfacePoints
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
CAUCHY_SCALE = 3.0
# A point of the outline is seen when the ray just inside hits the face this close to it, metres.
DEPTH_TOLERANCE = 0.01
POINTS_MIN = 8


@dataclass(frozen=True)
class Silhouette:
    """Outline points of one state and where the photo has the edge.

    Residuals are standard deviations.
    """

    points: SurfacePoints
    normals: np.ndarray  # (m, 2) unit, outward in the photo
    targets: np.ndarray  # (m, 2) pixels on the photo's edge
    sigma: float  # pixels
    share: float  # of an observation that one point counts for

    def residuals(self, state: State) -> np.ndarray:
        """(m,) signed distances across the edge; the outline is free to slide along it."""
        return (
            np.einsum("mc,mc->m", self.points.project(state) - self.targets, self.normals)
            / self.sigma
        )

    def weights(self, residuals: np.ndarray) -> np.ndarray:
        """(m,) robust, and for points that say the same as their neighbours."""
        return self.share / (1.0 + (residuals / CAUCHY_SCALE) ** 2)

    def robust_energy(self, residuals: np.ndarray) -> float:
        """The Cauchy energy that :meth:`weights` belong to."""
        return (
            0.5
            * CAUCHY_SCALE**2
            * self.share
            * float(np.log1p((residuals / CAUCHY_SCALE) ** 2).sum())
        )

    def jacobian(self, state: State, layout: Layout) -> np.ndarray:
        """(m, size) derivative of :meth:`residuals`."""
        return (
            np.einsum("mc,mck->mk", self.normals, self.points.jacobian(state, layout)) / self.sigma
        )


class SilhouetteTerm:
    """Finds the outline of a state and its place in the photo."""

    def __init__(self, forward: ForwardModel, photo: Photo, face_px: float) -> None:
        """``face_px``: the face's size in pixels of ``photo``."""
        self.forward, self.photo, self.face_px = forward, photo, face_px
        self._edges, self._sides = _mesh_edges(forward.geometry.triangles, forward.geometry.fitted)

    def find(self, state: State) -> Silhouette | None:
        """The outline at ``state``, or None where too little of it shows against another
        background.
        """
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
        return Silhouette(points, normal[chosen], targets, sigma, share)

    def _outline(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Edges (e, 2) between a fitted triangle that faces the camera and one that does not, and
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
        front = facing[self._sides]
        turn = front[:, 0] != front[:, 1]
        edges, sides, front = self._edges[turn], self._sides[turn], front[turn]
        near = np.where(front[:, 0], sides[:, 0], sides[:, 1])
        fitted = self.forward.geometry.fitted[near]
        edges, near = edges[fitted], near[fitted]
        third = triangles[near]
        other = (third != edges[:, :1]) & (third != edges[:, 1:])
        return edges, third[np.arange(len(third)), other.argmax(axis=1)]

    def _seen(
        self,
        state: State,
        vertices: np.ndarray,
        edges: np.ndarray,
        middle: np.ndarray,
        normal: np.ndarray,
    ) -> np.ndarray:
        """(m,) bool: nothing of the head lies just outside, and just inside lies the face
        itself.
        """
        outside = self.forward.hits(state, middle + 1.5 * normal).triangle < 0
        hits = self.forward.hits(state, middle - normal)
        inside = (hits.triangle >= 0) & self.forward.geometry.fitted[hits.triangle]
        depth = -vertices[self.forward.geometry.triangles[hits.triangle]][..., 2]
        depth = np.einsum("mi,mi->m", hits.barycentric, depth)
        edge_depth = -vertices[edges][..., 2].mean(axis=1)
        return outside & inside & (np.abs(depth - edge_depth) < DEPTH_TOLERANCE)

    def _edge_offset(self, middle: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """(m,) pixels along the outward normal to the photo's edge; NaN where the photo shows
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


def _mesh_edges(triangles: np.ndarray, fitted: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (e, 2) that two triangles share, one of them ``fitted`` at least, and these triangles
    (e, 2).
    """
    pairs = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(triangles)), 3)
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs, owner = pairs[order], owner[order]
    same = np.flatnonzero((pairs[1:] == pairs[:-1]).all(axis=1))
    edges, sides = pairs[same], np.stack([owner[same], owner[same + 1]], axis=1)
    keep = fitted[sides].any(axis=1)
    return edges[keep], sides[keep]
