"""Meshes before a head: shells over its skin, sheets, wires. Metres in the model frame."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from facestage.contract.face_model import SKIN, FaceModel

# what lies on the skin does not touch it; m from the edge to the full lift
SKIN_GAP, TAPER = 0.0008, 0.012
SUBDIVISIONS = 2
WIRE = 0.0018  # radius of the glasses' frame


def skin_vertices(model: FaceModel) -> np.ndarray:
    """(n,) bool: vertices of skin triangles."""
    marked = np.zeros(len(model.vertices), bool)
    marked[model.triangles[model.triangle_part == SKIN]] = True
    return marked


def shell(
    model: FaceModel,
    vertices: np.ndarray,
    edge: Callable[[np.ndarray], np.ndarray],
    thickness: Callable[[np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """The skin above a height, lifted off the head; points and triangles.

    ``edge`` and ``thickness`` give the height and the lift (m,) at points (m, 3); the lift starts
    from 0 at the edge.
    """
    skin = model.triangles[model.triangle_part == SKIN]
    corners = vertices[skin].astype(np.float64)
    normal = np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(
            normal,
            skin[:, corner],
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]),
        )
    points, triangles = np.concatenate([vertices, normal], axis=1), skin
    # The meshes of heads are coarse where hair grows.
    for _ in range(SUBDIVISIONS):
        near = (points[:, 1] > edge(points[:, :3]) - 0.01)[triangles].any(axis=1)
        points, triangles = subdivided(points, triangles[near])
    position, normal = points[:, :3], points[:, 3:]
    above = position[:, 1] - edge(position)
    lift = SKIN_GAP + thickness(position) * np.clip(above / TAPER, 0, 1) ** 0.5
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    used, triangles = np.unique(triangles[(above > 0)[triangles].all(axis=1)], return_inverse=True)
    return (position + lift[:, None] * normal)[used], triangles.reshape(-1, 3)


def subdivided(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each triangle as four, with the midpoints of its edges; points (n, c) of any number of
    coordinates.
    """
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    ends, middle = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    ab, bc, ca = (len(points) + middle.reshape(-1, 3)).T
    a, b, c = triangles.T
    finer = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]).transpose(2, 0, 1)
    return np.concatenate([points, points[ends].mean(axis=1)]), finer.reshape(-1, 3)


def front(points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(m,) z of the frontmost of the points (n, 3) within 5 mm of each place (m, 2)."""
    distance = np.linalg.norm(points[None, :, :2] - at[:, None], axis=-1)
    near = np.where(
        distance < np.maximum(0.005, distance.min(axis=1, keepdims=True)) + 1e-9,
        points[:, 2],
        -np.inf,
    )
    return near.max(axis=1)


def half_width(points: np.ndarray, side: float, level: float, depth: float) -> float:
    """How far points (n, 3) reach to a side around a height and a depth; 0 where there are none."""
    near = (np.abs(points[:, 1] - level) < 0.007) & (np.abs(points[:, 2] - depth) < 0.008)
    return max(0.0, float((side * points[near, 0]).max())) if near.any() else 0.0


def sheet(grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a grid of points (r, c, 3)."""
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2)
    return grid.reshape(-1, 3), triangles.reshape(-1, 3)


def tube(path: np.ndarray, closed: bool = False, sides: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a wire of radius WIRE along a path (m, 3)."""
    if closed:
        path = np.concatenate([path, path[:1]])
    along = np.gradient(path, axis=0)
    if closed:
        along[0] = along[-1] = path[1] - path[-2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # No part of a pair of glasses runs along this direction.
    first = np.cross(along, np.array([0.31, 0.37, 0.26]))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(along, first)
    turn = np.linspace(0, 2 * np.pi, sides + 1)[:, None]
    return sheet(
        path[:, None] + WIRE * (np.cos(turn) * first[:, None] + np.sin(turn) * second[:, None])
    )


def joined_parts(parts: Sequence[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of several meshes as one."""
    starts = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    return (
        np.concatenate([points for points, _ in parts]),
        np.concatenate(
            [triangles + start for (_, triangles), start in zip(parts, starts, strict=True)]
        ),
    )
