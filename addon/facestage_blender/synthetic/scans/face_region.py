"""Which vertices of a scan are its face: what a camera in front of it sees between the landmarks
that were found there.
"""

from __future__ import annotations

import numpy as np
from mathutils.bvhtree import BVHTree
from mathutils.geometry import convex_hull_2d

from facestage.contract.camera import Camera

from ..sightlines import unhidden

TOLERANCE_MM = 1.0
# Skin that the camera sees at a steeper angle than this, in degrees, lies inside nostrils and lips
# or behind the cheek's outline, where a face model's mesh ends or is folded otherwise.
STEEPEST = 80.0


def face_vertices(
    vertices: np.ndarray, triangles: np.ndarray, camera: Camera, landmarks: np.ndarray
) -> np.ndarray:
    """Numbers of the vertices (n, 3), mm in the camera's frame, that the camera sees inside the
    convex hull of the landmarks (m, 2) in pixels.
    """
    inside = np.flatnonzero(within_hull(camera.project(vertices), landmarks))
    tree = BVHTree.FromPolygons(vertices.tolist(), triangles.tolist())
    seen = inside[unhidden(tree, vertices[inside], TOLERANCE_MM)]
    normal = _normals(vertices, triangles)[seen]
    towards = -vertices[seen] / np.linalg.norm(vertices[seen], axis=1, keepdims=True)
    return seen[(normal * towards).sum(axis=1) > np.cos(np.radians(STEEPEST))]


def within_hull(points: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """(n,) bool: which points (n, 2) lie inside the convex hull of others (m, 2)."""
    ring = corners[convex_hull_2d([tuple(corner) for corner in corners.tolist()])]
    edge, offset = np.roll(ring, -1, axis=0) - ring, points[:, None] - ring
    side = edge[:, 0] * offset[..., 1] - edge[:, 1] * offset[..., 0]
    # Whichever way round the hull is given.
    return (side >= 0).all(axis=1) | (side <= 0).all(axis=1)


def _normals(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n, 3) unit normals, weighted by area."""
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    cross, total = np.cross(b - a, c - a), np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(total, triangles[:, corner], cross)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300)
