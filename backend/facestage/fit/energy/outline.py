"""The face's outline in a state: the edges of the mesh where skin turns away from the camera."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from facestage.contract.arrays import Bool, Float, Int
from facestage.contract.face_model import SKIN
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel

# Metres that what shows just outside of an edge must lie behind it, as neck and ears do, or the
# edge is a fold of one surface.
BEHIND_MIN = 0.015
# Just inside, one sees the face itself: how far skin of this radius of curvature comes forward
# within a pixel, with some room, and at least so far, metres.
RADIUS, ROOM, FORWARD_MIN = 0.08, 1.3, 0.01
# Just outside and just inside, pixels.
_OUTSIDE, _INSIDE = 1.5, 1.0


@dataclass(frozen=True, eq=False)
class Outline:
    """m places in the middles of edges, at most one for each pixel that the outline crosses."""

    edges: Int[np.ndarray, "places 2"]  # rendered vertices
    middle: Float[np.ndarray, "places 2"]  # pixels
    normal: Float[np.ndarray, "places 2"]  # unit, outward in the photo

    def part(self, chosen: np.ndarray) -> Outline:
        """Some of the places (indices or a mask)."""
        return Outline(self.edges[chosen], self.middle[chosen], self.normal[chosen])


@dataclass(frozen=True, eq=False)
class OutlineFinder:
    """Knows the mesh."""

    forward: ForwardModel

    def at(self, state: State) -> Outline:
        """What of the outline is to be seen in ``state``."""
        edges, opposite = self._turning(state)
        vertices = self.forward.pose(state)[1]
        pixels = state.camera.project(vertices)
        middle = 0.5 * (pixels[edges[:, 0]] + pixels[edges[:, 1]])
        along = pixels[edges[:, 1]] - pixels[edges[:, 0]]
        length = np.linalg.norm(along, axis=1)
        normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.maximum(length, 1e-9)[:, None]
        normal *= -np.sign(np.einsum("ec,ec->e", normal, pixels[opposite] - middle))[:, None]
        keep = np.flatnonzero((length > 1e-6) & np.isfinite(middle).all(axis=1))
        _, first = np.unique(np.floor(middle[keep]).astype(int), axis=0, return_index=True)
        chosen = keep[first]
        edges, middle, normal = edges[chosen], middle[chosen], normal[chosen]
        seen = self._seen(state, vertices, edges, middle, normal)
        return Outline(edges, middle, normal).part(seen)

    @cached_property
    def _mesh(self) -> tuple[Int[np.ndarray, "edges 2"], Int[np.ndarray, "edges 2"]]:
        geometry = self.forward.geometry
        return mesh_edges(geometry.triangles, geometry.fitted)

    def _turning(
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
        """Just outside there is nothing of the head, or skin beside the face well behind it, and
        just inside the face itself.
        """
        depth = -vertices[edges][..., 2].mean(axis=1)
        outside, behind = self._hits(state, vertices, middle + _OUTSIDE * normal)
        geometry = self.forward.geometry
        skin = ~geometry.fitted & (geometry.triangle_part == SKIN)
        before_skin = (outside >= 0) & skin[outside] & (behind > depth + BEHIND_MIN)
        inside, before = self._hits(state, vertices, middle - _INSIDE * normal)
        face = (inside >= 0) & geometry.fitted[inside]
        pixel = depth / state.camera.focal_px
        forward = np.maximum(FORWARD_MIN, ROOM * np.sqrt(2 * RADIUS * _INSIDE * pixel))
        return ((outside < 0) | before_skin) & face & (np.abs(before - depth) < forward)

    def _hits(
        self,
        state: State,
        vertices: Float[np.ndarray, "vertices 3"],
        pixels: Float[np.ndarray, "points 2"],
    ) -> tuple[Int[np.ndarray, " points"], Float[np.ndarray, " points"]]:
        """The triangles that are seen there, -1 for none, and how far away they are, metres."""
        hits = self.forward.hits(state, pixels)
        corners = -vertices[self.forward.geometry.triangles[hits.triangle]][..., 2]
        return hits.triangle, np.einsum("mi,mi->m", hits.barycentric, corners)


def mesh_edges(
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
