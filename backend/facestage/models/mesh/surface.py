"""A triangle mesh as a surface that is asked for its nearest point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from facestage.contract.errors import InputError

# Samples of the whole surface: enough that a nearest sample lies on, or beside, the nearest
# triangle.
SAMPLES = 60_000
_MAX_SUBDIVISION = 24
_CANDIDATES = 10
_WELD = 1_000_000  # a mesh's size over the distance within which its vertices are one
# three numbers from 0 to _WELD as one
_PLACES = np.array([(_WELD + 1) ** 2, _WELD + 1, 1], np.int64)


@dataclass(frozen=True)
class Nearest:
    """Nearest points of m queries; where no triangle agreed with the query's normal, ``distance``
    is infinite and the rest means nothing.
    """

    triangle: np.ndarray  # (m,) int
    weights: np.ndarray  # (m, 3) barycentric
    point: np.ndarray  # (m, 3)
    normal: np.ndarray  # (m, 3) unit, of the triangle
    distance: np.ndarray  # (m,)
    boundary: np.ndarray  # (m,) bool: the nearest point lies on an open edge of the mesh


class Surface:
    """Triangles (t, 3) over vertices (n, 3), any unit and frame; degenerate triangles are left
    out.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray) -> None:
        self.vertices = np.asarray(vertices, np.float64)
        triangles = np.asarray(triangles, np.int64).reshape(-1, 3)
        normal, area = normals_and_areas(self.vertices, triangles)
        size = float(np.ptp(self.vertices, axis=0).max()) if len(self.vertices) else 0.0
        kept = area > 1e-14 * size**2
        if not kept.any() or not np.isfinite(size):
            raise InputError(
                "The mesh has no surface: expected triangles with an area; choose the mesh of "
                "a face."
            )
        self.triangles, self.normal, self.area = triangles[kept], normal[kept], area[kept]
        self.open_edge = _open_edges(self.vertices, self.triangles)
        self.corners = self.vertices[self.triangles]
        self.sample_triangle, self.sample = self._samples()
        # how far the sample's triangle reaches from it, with a billionth for rounding
        arms = self.corners[self.sample_triangle] - self.sample[:, None]
        self.sample_reach = (1 + 1e-9) * np.sqrt(_dot(arms, arms).max(axis=1))
        self.tree = cKDTree(self.sample)

    def _samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Centres of the small triangles that each triangle is split into, so that all are of
        similar extent.
        """
        corners = self.corners
        longest = np.sqrt(((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=2).max(axis=1))
        spacing = np.sqrt(2.0 * self.area.sum() / SAMPLES)
        count = np.clip(np.ceil(longest / spacing), 1, _MAX_SUBDIVISION).astype(int)
        owner, points = [], []
        for step in np.unique(count):
            chosen = np.flatnonzero(count == step)
            weights = _centres(int(step))
            points.append(np.einsum("sk,tkc->tsc", weights, corners[chosen]).reshape(-1, 3))
            owner.append(np.repeat(chosen, len(weights)))
        return np.concatenate(owner), np.concatenate(points)

    def nearest(
        self, points: np.ndarray, normals: np.ndarray | None = None, cosine: float = 0.5
    ) -> Nearest:
        """Nearest point of each query (m, 3), among triangles whose normal agrees with ``normals``
        when given.
        """
        points = np.asarray(points, np.float64)
        candidates = min(_CANDIDATES if normals is None else 2 * _CANDIDATES, len(self.sample))
        to_sample, sample = self.tree.query(points, k=candidates)
        to_sample = np.asarray(to_sample).reshape(len(points), candidates)
        sample = np.asarray(sample).reshape(len(points), candidates)
        triangle = self.sample_triangle[sample]
        asked = np.ones(triangle.shape, bool)
        if normals is not None:
            asked = np.einsum("mqc,mc->mq", self.normal[triangle], normals) > cosine
        # A triangle is no further than a sample of it, and nearer by at most how far it reaches.
        nearest_sample = np.where(asked, to_sample, np.inf).min(axis=1, keepdims=True)
        asked &= to_sample - self.sample_reach[sample] <= nearest_sample
        for k in range(1, candidates):
            asked[:, k] &= ~(triangle[:, :k] == triangle[:, k : k + 1]).any(axis=1)
        query, candidate = np.nonzero(asked)
        corners = self.corners[triangle[query, candidate]]
        found = closest_weights(points[query], corners)
        weights = np.zeros((*triangle.shape, 3))
        weights[query, candidate] = found
        foot = np.zeros((*triangle.shape, 3))
        foot[query, candidate] = np.einsum("ik,ikc->ic", found, corners)
        distance = np.full(triangle.shape, np.inf)
        away = foot[query, candidate] - points[query]
        distance[query, candidate] = np.linalg.norm(away, axis=1)
        best = distance.argmin(axis=1)
        row = np.arange(len(points))
        triangle, weights = triangle[row, best], weights[row, best]
        # On edge k, opposite corner k, the weight of corner k is 0.
        boundary = (self.open_edge[triangle] & (weights < 1e-6)).any(axis=1)
        return Nearest(
            triangle, weights, foot[row, best], self.normal[triangle], distance[row, best], boundary
        )

    def flipped(self) -> Surface:
        """The same surface with its inside out."""
        return Surface(self.vertices, self.triangles[:, ::-1])


def normals_and_areas(vertices: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (t, 3), zero for a degenerate triangle, and areas (t,)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(length, 1e-300)[:, None], 0.5 * length


def vertex_normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals, area-weighted; zero where no triangle is."""
    normal, area = normals_and_areas(vertices, triangles)
    total = np.zeros((len(vertices), 3))
    for axis in range(3):
        for corner in range(3):
            total[:, axis] += np.bincount(
                triangles[:, corner], normal[:, axis] * area, len(vertices)
            )
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]


def closest_weights(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Barycentric weights (..., 3) of the point of each triangle (..., 3, 3) that is nearest to a
    point (..., 3).
    """
    a, b, c = corners[..., 0, :], corners[..., 1, :], corners[..., 2, :]
    u, v, w = b - a, c - a, points - a
    uu, uv, vv = _dot(u, u), _dot(u, v), _dot(v, v)
    wu, wv = _dot(w, u), _dot(w, v)
    area = np.maximum(uu * vv - uv * uv, 1e-300)
    beta, gamma = (vv * wu - uv * wv) / area, (uu * wv - uv * wu) / area
    inside = np.stack([1 - beta - gamma, beta, gamma], axis=-1)
    lies_inside = (beta >= 0) & (gamma >= 0) & (beta + gamma <= 1)
    best, best_distance = inside, np.where(lies_inside, 0.0, np.inf)
    # Outside: the nearest point of the three edges.
    for first, second in ((0, 1), (1, 2), (2, 0)):
        start, edge = corners[..., first, :], corners[..., second, :] - corners[..., first, :]
        t = np.clip(_dot(points - start, edge) / np.maximum(_dot(edge, edge), 1e-300), 0.0, 1.0)
        away = start + t[..., None] * edge - points
        distance = 1e-300 + _dot(away, away)
        weights = np.zeros_like(inside)
        weights[..., first], weights[..., second] = 1 - t, t
        nearer = distance < best_distance
        best = np.where(nearer[..., None], weights, best)
        best_distance = np.where(nearer, distance, best_distance)
    return best


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 0] + a[..., 1] * b[..., 1] + a[..., 2] * b[..., 2]


def _centres(step: int) -> np.ndarray:
    """(step^2, 3) barycentric centres of the triangles that ``step`` cuts on each side make."""
    up = [(i + 1 / 3, j + 1 / 3) for i in range(step) for j in range(step - i)]
    down = [(i + 2 / 3, j + 2 / 3) for i in range(step - 1) for j in range(step - 1 - i)]
    beta, gamma = np.array(up + down).T / step
    return np.stack([1 - beta - gamma, beta, gamma], axis=1)


def pieces(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) int: the connected piece of each vertex, coinciding vertices being one."""
    point = welded(vertices)
    a, b, c = point[triangles].T
    count = int(point.max()) + 1
    rows, columns = np.concatenate([a, b]), np.concatenate([b, c])
    graph = coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), (count, count))
    return connected_components(graph, directed=False)[1][point]


def welded(vertices: np.ndarray) -> np.ndarray:
    """(n,) int: one number for each distinct place, to a millionth of the mesh's size."""
    size = max(float(np.ptp(vertices, axis=0).max()), 1e-300)
    keys = np.round((vertices - vertices.min(axis=0)) / size * _WELD).astype(np.int64)
    return np.unique(keys @ _PLACES, return_inverse=True)[1].ravel()


def _open_edges(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(t, 3) bool: the edge opposite each corner belongs to one triangle only."""
    corner = welded(vertices)[triangles]
    edges = np.stack([corner[:, [1, 2]], corner[:, [2, 0]], corner[:, [0, 1]]], axis=1)
    low, high = np.sort(edges.reshape(-1, 2), axis=1).T
    keys = low * (int(corner.max()) + 1) + high
    _, inverse, count = np.unique(keys, return_inverse=True, return_counts=True)
    return (count[inverse.ravel()] == 1).reshape(-1, 3)
