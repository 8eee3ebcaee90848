"""Which point of a mesh's surface shows at a pixel. No bpy."""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Bool, Float, Integer

EDGE = 1e-9  # a point on an edge lies in both triangles


def surface_at(
    pixel: Float[np.ndarray, " 2"],
    pixels: Float[np.ndarray, "vertices 2"],
    depths: Float[np.ndarray, " vertices"],
    triangles: Integer[np.ndarray, "triangles 3"],
) -> tuple[Integer[np.ndarray, " 3"], Float[np.ndarray, " 3"]] | None:
    """The corners of the nearest triangle that faces the camera at ``pixel``, and the barycentric
    weights of what shows there, on the surface; None where there is none.

    ``pixels`` (y down) and ``depths`` > 0 are the vertices' in the camera; NaN is behind it.
    """
    a, b, c = (pixels[triangles[:, corner]] for corner in range(3))
    area = _cross(b - a, c - a)
    front = area < 0  # counter-clockwise from outside; y points down
    weights = np.stack([_cross(b - pixel, c - pixel), _cross(c - pixel, a - pixel)], axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        weights /= area[:, None]
        weights = np.c_[weights, 1.0 - weights.sum(axis=1)]
        hit = np.flatnonzero(front & (weights >= -EDGE).all(axis=1))
    if not len(hit):
        return None
    # What is linear on the screen is the weights over the depths.
    nearness = weights[hit] / depths[triangles[hit]]
    best = int(np.argmax(nearness.sum(axis=1)))
    found = np.maximum(nearness[best], 0.0)
    return triangles[hit[best]], found / found.sum()


def facing(
    pixels: Float[np.ndarray, "vertices 2"], triangles: Integer[np.ndarray, "triangles 3"]
) -> Bool[np.ndarray, " triangles"]:
    """Which triangles show their outer side."""
    a, b, c = (pixels[triangles[:, corner]] for corner in range(3))
    return np.asarray(_cross(b - a, c - a) < 0)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
