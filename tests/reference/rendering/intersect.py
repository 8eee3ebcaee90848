"""Rays against every triangle of a mesh (Moeller & Trumbore 1997), without any acceleration."""

from __future__ import annotations

import numpy as np


def intersections(
    origin: np.ndarray, directions: np.ndarray, vertices: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance (P, t), infinite where missed, and barycentric u, v (P, t) of every ray and
    triangle.
    """
    origin = np.broadcast_to(origin, directions.shape).astype(float)[:, None]
    directions = directions.astype(float)[:, None]
    a, b, c = (vertices.astype(float)[triangles[:, corner]][None] for corner in range(3))
    edge1, edge2 = b - a, c - a
    p = np.cross(directions, edge2)
    determinant = (edge1 * p).sum(-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / determinant
        s = origin - a
        u = (s * p).sum(-1) * inverse
        q = np.cross(s, np.broadcast_to(edge1, s.shape))
        v = (directions * q).sum(-1) * inverse
        distance = (edge2 * q).sum(-1) * inverse
        hit = (np.abs(determinant) > 1e-18) & (u >= 0) & (v >= 0) & (u + v <= 1) & (distance > 0)
    return np.where(hit, distance, np.inf), u, v


def first_hits(
    origin: np.ndarray, directions: np.ndarray, vertices: np.ndarray, triangles: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Triangle (P,) or -1, barycentric weights (P, 3) and distance (P,) of the nearest hit."""
    distance, u, v = intersections(origin, directions, vertices, triangles)
    nearest = distance.argmin(1)
    row = np.arange(len(directions))
    found = np.isfinite(distance[row, nearest])
    u, v = u[row, nearest], v[row, nearest]
    return np.where(found, nearest, -1), np.stack([1 - u - v, u, v], 1), distance[row, nearest]


def occluded(
    start: np.ndarray, target: np.ndarray, vertices: np.ndarray, triangles: np.ndarray
) -> np.ndarray:
    """(P,) bool: whether any triangle lies between ``start`` (P, 3) and ``target`` (P, 3)."""
    offset = target - start
    length = np.linalg.norm(offset, axis=1)
    distance, _, _ = intersections(start, offset / length[:, None], vertices, triangles)
    return distance.min(1) < length * (1 - 1e-4)
