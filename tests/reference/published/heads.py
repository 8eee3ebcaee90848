"""Heads with the vertex counts that FLAME, the Basel Face Model and GNM publish, without their
data.

The surface is the default head seen from a point inside it, so that a picture of one looks like a
face.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial import ConvexHull, cKDTree

from facestage.contract.face_model import SKIN, FaceModel
from facestage.models.registry import load_model

CENTRE = np.array([0.0, -0.01, -0.07])  # m, inside the default head


@dataclass(frozen=True)
class Head:
    """A head in metres, +Y up, looking along +Z, its jaw at rest."""

    vertices: np.ndarray  # (n, 3)
    triangles: np.ndarray  # (t, 3), counter-clockwise from outside
    landmark_triangle: np.ndarray  # (68,) row of `triangles`
    landmark_weights: np.ndarray  # (68, 3)

    @property
    def landmarks(self) -> np.ndarray:
        """(68, 3) places of the ibug landmarks."""
        corners = self.vertices[self.triangles[self.landmark_triangle]]
        return np.einsum("mk,mkc->mc", self.landmark_weights, corners)


@cache
def _seen_from_inside() -> tuple[cKDTree, np.ndarray]:
    """Directions and distances of the outer skin of the default head."""
    model = load_model("default")
    outer = np.setdiff1d(np.unique(model.triangles[model.triangle_part == SKIN]), _inner(model))
    offset = model.vertices[outer].astype(float) - CENTRE
    distance = np.linalg.norm(offset, axis=1)
    return cKDTree(offset / distance[:, None]), distance


def _inner(model: FaceModel) -> np.ndarray:
    """Vertices of the skin that something else of the head lies before, as seen from inside."""
    offset = model.vertices.astype(float) - CENTRE
    distance = np.linalg.norm(offset, axis=1)
    tree = cKDTree(offset / distance[:, None])
    near = tree.query(offset / distance[:, None], 12)[1]
    return np.flatnonzero(distance < 0.9 * distance[near].max(axis=1))


def _fibonacci(count: int) -> np.ndarray:
    """(count, 3) even directions, denser before the face."""
    k = np.arange(count) + 0.5
    height, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    across = np.sqrt(1 - height**2)
    points = np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)
    # Drawn towards +Z.
    pulled = points + np.array([0, 0, 0.45])
    return pulled / np.linalg.norm(pulled, axis=1, keepdims=True)


def head(count: int, ring: int = 0) -> Head:
    """A head of ``count`` vertices; with ``ring``, so many of them round an open neck.

    2 count - 4 triangles, and ring - 2 fewer with a neck.
    """
    directions = _fibonacci(count - ring)
    if ring:
        # Nothing lies below the neck's ring.
        low = -0.80
        directions[:, 1] = np.where(
            directions[:, 1] < low + 0.03,
            low + 0.03 + 0.9 * (directions[:, 1] - low),
            directions[:, 1],
        )
        directions[:, 1] = np.maximum(
            directions[:, 1], low + 0.02 + 1e-3 * np.arange(count - ring) / count
        )
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        keep = directions[:, 1] > low + 0.005
        directions[~keep] = _fibonacci(3 * count)[: (~keep).sum()]
        turn = 2 * np.pi * np.arange(ring) / ring
        across = np.sqrt(1 - low**2)
        directions = np.concatenate(
            [
                directions,
                np.stack([across * np.sin(turn), np.full(ring, low), across * np.cos(turn)], 1),
            ]
        )
    hull = ConvexHull(directions, qhull_options="Qt").simplices
    if ring:
        hull = hull[~(hull >= count - ring).all(axis=1)]
    a, b, c = (directions[hull[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0
    hull[inward] = hull[inward][:, ::-1]
    tree, distance = _seen_from_inside()
    gap, near = tree.query(directions, 6)
    weight = 1.0 / (gap + 0.01) ** 2
    radius = (weight * distance[near]).sum(1) / weight.sum(1)
    vertices = CENTRE + radius[:, None] * directions
    return Head(vertices, hull.astype(np.int64), *_landmarks(directions, hull))


def _landmarks(directions: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The default head's landmarks on a head of these directions: triangle rows and weights."""
    model = load_model("default")
    vertex = model.landmarks["ibug68"][:, 0].astype(int)
    wanted = model.vertices[vertex].astype(float) - CENTRE
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    rows, weights = [], []
    middles = directions[triangles].mean(axis=1)
    for place in wanted:
        best = (-np.inf, 0, np.zeros(3))
        for row in np.argsort(-(middles @ place))[:40]:
            share = np.linalg.solve(directions[triangles[row]].T, place)
            if share.min() > best[0]:
                best = (share.min(), int(row), share)
        share = np.maximum(best[2], 0)
        rows.append(best[1])
        weights.append(share / share.sum())
    return np.array(rows), np.array(weights)


def ball(count: int, radius: float, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An eyeball of ``count`` vertices and 2 count - 4 triangles."""
    directions = _fibonacci(count)
    hull = ConvexHull(directions).simplices
    a, b, c = (directions[hull[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) < 0
    hull[inward] = hull[inward][:, ::-1]
    return centre + radius * directions, hull.astype(np.int64)


def smooth_modes(vertices: np.ndarray, count: int, size: float, seed: int) -> np.ndarray:
    """(count, n, 3) m, smooth displacement fields that fall off like the modes of a statistical
    model.
    """
    random = np.random.default_rng(seed)
    span = np.ptp(vertices, axis=0).max()
    result = np.empty((count, len(vertices), 3), np.float32)
    for k in range(count):
        wave = random.normal(size=3) * (2.0 + 0.06 * k) / span
        field = np.cos(vertices @ wave * np.pi + random.uniform(0, 2 * np.pi))
        result[k] = size / (1 + 0.2 * k) * field[:, None] * random.normal(size=3)
    return result
