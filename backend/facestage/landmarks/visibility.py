"""Which points of a mesh the camera sees: the face hides some of itself when it is turned."""

from __future__ import annotations

import numpy as np

from facestage.landmarks.canonical import LEFT_IRIS, RIGHT_IRIS, SURFACE_COUNT, CanonicalFace

# A point whose surface is seen under less than about 6 degrees cannot be placed along it.
GRAZING = 0.1
# What lies in front by more than this share of the face's width hides a point: the depths are
# estimates.
DEPTH_MARGIN = 0.05
# Inner and outer corner, upper and lower lid of each eye.
EYES = ((RIGHT_IRIS, (133, 33), (159, 145)), (LEFT_IRIS, (362, 263), (386, 374)))
# Lids closer than this share of the eye's width hide the iris.
CLOSED = 0.1


def visible_points(points: np.ndarray, face: CanonicalFace) -> np.ndarray:
    """(478,) bool for a mesh (478, 3): x right, y down, z away from the camera, all in one unit."""
    surface = points[:SURFACE_COUNT]
    seen = np.ones(len(points), bool)
    seen[:SURFACE_COUNT] = _facing(surface, face.triangles) & ~_covered(surface, face.triangles)
    for iris, corners, lids in EYES:
        width = np.linalg.norm(np.subtract(*points[list(corners)]))
        opening = np.linalg.norm(np.subtract(*points[list(lids)]))
        seen[list(iris)] = seen[list(corners)].all() and opening > CLOSED * width
    return seen


def _facing(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) bool, the vertices whose surface turns to the camera."""
    a, b, c = points[triangles].transpose(1, 0, 2)
    normals = np.cross(b - a, c - a)
    total = np.zeros_like(points)
    for corner in triangles.T:
        np.add.at(total, corner, normals)
    length = np.maximum(np.linalg.norm(total, axis=1), 1e-12)
    return np.asarray(-total[:, 2] / length > GRAZING)


def _covered(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """(n,) bool, the vertices that lie behind a triangle."""
    margin = DEPTH_MARGIN * float(np.ptp(points[:, 0]) + np.ptp(points[:, 1])) / 2
    corners = points[triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    # Few triangles lie around a point at all, and before it.
    near = low[:, 2] < points[:, 2, None] - margin
    for axis in range(2):
        place = points[:, axis, None]
        near &= (low[:, axis] <= place) & (place <= high[:, axis])
    point, triangle = np.nonzero(near)
    a, b, c = corners[triangle].transpose(1, 0, 2)
    first, second, offset = b - a, c - a, points[point] - a
    area = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
    # A triangle seen edge on covers nothing: it divides by zero, and no comparison holds.
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (offset[:, 0] * second[:, 1] - offset[:, 1] * second[:, 0]) / area
        v = (first[:, 0] * offset[:, 1] - first[:, 1] * offset[:, 0]) / area
        depth = a[:, 2] + u * first[:, 2] + v * second[:, 2]
        hides = (u >= 0) & (v >= 0) & (u + v <= 1) & (depth < points[point, 2] - margin)
    result = np.zeros(len(points), bool)
    result[point[hides]] = True
    return result
