"""Where a landmark of the face's outline may lie: lines over the cheeks, from the front of the face
to the landmark.

What an annotator marks as the outline is where the face ends in the picture, on another point of
the skin for every pose. Each landmark of the outline therefore has a line of candidates on the
surface, the meridian that leads to it from the axis of the face, and of those the one that shows
furthest out is the outline (Cao et al. 2014, "Displaced Dynamic Expression Regression"). On the
side that is turned to the camera that is the landmark itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry

CANDIDATES = 40  # about two millimetres apart
# Share of the angle between straight ahead and the landmark where a line starts: on the cheek, not
# on nose or lips.
LINE_START = 0.22


@dataclass(frozen=True)
class ContourLines:
    """k lines of c candidates, the last of each the landmark itself; rendered-vertex indices."""

    corners: Int[np.ndarray, "lines candidates 3"]
    weights: Float[np.ndarray, "lines candidates 3"]  # barycentric
    centre: Float[np.ndarray, " 3"]  # m, model frame: on the axis of the face
    # unit, model frame: from the axis to the landmark, at right angles to the axis
    outward: Float[np.ndarray, "lines 3"]


def contour_lines(
    geometry: FaceGeometry,
    corners: Int[np.ndarray, "lines 3"],
    weights: Float[np.ndarray, "lines 3"],
) -> ContourLines:
    """Lines on the mean face to the landmarks ``corners`` with ``weights``."""
    points = np.einsum("ki,kix->kx", weights, geometry.mean[corners])
    low, high = points.min(axis=0), points.max(axis=0)
    centre = np.array([*(0.5 * (low + high))[:2], low[2]])
    radial = (points - centre) * [1.0, 1.0, 0.0]
    outward = radial / np.maximum(np.linalg.norm(radial, axis=1, keepdims=True), 1e-9)
    triangles = geometry.triangles[geometry.triangle_part == SKIN]
    # Only what lies in front of the landmarks can hold candidates.
    triangles = triangles[(geometry.mean[triangles][..., 2] > centre[2] - 0.01).all(axis=1)]
    line_corners = np.repeat(corners[:, None], CANDIDATES, axis=1)
    line_weights = np.repeat(weights[:, None], CANDIDATES, axis=1)
    for line, (point, aside) in enumerate(zip(points, outward, strict=True)):
        last = np.arctan2((point - centre) @ aside, point[2] - centre[2])
        angles = np.linspace(LINE_START * last, last, CANDIDATES)[:-1]
        rays = np.cos(angles)[:, None] * [0.0, 0.0, 1.0] + np.sin(angles)[:, None] * aside
        found, barycentric = _outermost(geometry.mean, triangles, centre, rays)
        # Rays that leave through the eyes or the mouth have no skin: the next one stands in for
        # them.
        for at in range(CANDIDATES - 2, -1, -1):
            if found[at] >= 0:
                line_corners[line, at], line_weights[line, at] = (
                    triangles[found[at]],
                    barycentric[at],
                )
            else:
                line_corners[line, at], line_weights[line, at] = (
                    line_corners[line, at + 1],
                    line_weights[line, at + 1],
                )
    return ContourLines(line_corners, line_weights, centre, outward)


def _outermost(
    vertices: Float[np.ndarray, "vertices 3"],
    triangles: Int[np.ndarray, "triangles 3"],
    origin: Float[np.ndarray, " 3"],
    rays: Float[np.ndarray, "rays 3"],
) -> tuple[Int[np.ndarray, " rays"], Float[np.ndarray, "rays 3"]]:
    """Index of the last triangle that each ray in one plane hits, -1 for none, and its weights."""
    across = np.cross(rays[0], rays[-1])
    side = ((vertices - origin) @ across)[triangles]
    index = np.flatnonzero((side.min(axis=1) <= 0) & (side.max(axis=1) >= 0))
    if not len(index):
        return np.full(len(rays), -1), np.zeros((len(rays), 3))
    near = triangles[index]
    a, b, c = (vertices[near[:, corner]] - origin for corner in range(3))
    # Möller and Trumbore 1997, for all pairs of ray and triangle.
    ray = rays[:, None]
    p = np.cross(ray, c - a)
    determinant = np.einsum("rtx,tx->rt", p, b - a)
    safe = np.where(np.abs(determinant) > 1e-18, determinant, np.inf)
    u = np.einsum("rtx,tx->rt", p, -a) / safe
    q = np.cross(-a, b - a)
    v = np.einsum("rx,tx->rt", rays, q) / safe
    distance = np.einsum("tx,tx->t", c - a, q) / safe
    hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9) & (distance > 0)
    last, rows = np.where(hit, distance, -1.0).argmax(axis=1), np.arange(len(rays))
    weights = np.stack([1 - u - v, u, v], axis=2)[rows, last]
    return np.where(hit[rows, last], index[last], -1), weights
