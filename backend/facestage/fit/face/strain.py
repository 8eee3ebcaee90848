"""How much, and which way, an expression presses the skin together: the least stretch of each
triangle, of membranes as in Bonet and Wood 2008, section 3.6.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float, Int

DEGENERATE = 1e-8  # square root of twice a triangle's area, metres, below which it has no plane


@dataclass(frozen=True, eq=False)
class SkinPlanes:
    """The triangles of a shape at rest, each in coordinates of its own plane."""

    triangles: Int[np.ndarray, "triangles 3"]
    axes: Float[np.ndarray, "triangles 2 3"]  # orthonormal, of the shape's frame
    inverse: Float[np.ndarray, "triangles 2 2"]  # of the two edges from the first corner; else 0
    area: Float[np.ndarray, " triangles"]  # twice, m^2

    @classmethod
    def of(
        cls, vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]
    ) -> SkinPlanes:
        """Those of ``vertices``."""
        edges = _edges(vertices, triangles)
        normal = np.cross(edges[..., 0], edges[..., 1])
        area = np.linalg.norm(normal, axis=1)
        flat = area > DEGENERATE**2
        x = edges[..., 0] / np.maximum(np.linalg.norm(edges[..., 0], axis=1), 1e-30)[:, None]
        y = np.cross(normal / np.maximum(area, 1e-30)[:, None], x)
        axes = np.stack([x, y], axis=1)
        within = np.where(flat[:, None, None], axes @ edges, np.eye(2))
        return cls(triangles, axes, np.linalg.inv(within) * flat[:, None, None], area)

    def gradient(
        self, values: Float[np.ndarray, "vertices dimensions"]
    ) -> Float[np.ndarray, "triangles dimensions 2"]:
        """By how much ``values`` on the vertices change along a triangle's axes, by the metre."""
        return _edges(values, self.triangles) @ self.inverse

    def pressed(
        self, vertices: Float[np.ndarray, "vertices 3"]
    ) -> tuple[Float[np.ndarray, " triangles"], Float[np.ndarray, "triangles 2"]]:
        """What share of its length each triangle loses in the direction, of unit length, that loses
        most where the vertices are at ``vertices``; negative where it gains in all.
        """
        gradient = self.gradient(vertices)
        squares, directions = np.linalg.eigh(np.swapaxes(gradient, 1, 2) @ gradient)
        lost = np.where(self.inverse.any(axis=(1, 2)), 1 - np.sqrt(np.maximum(squares[:, 0], 0)), 0)
        return lost, directions[..., 0]


def _edges(
    values: Float[np.ndarray, "vertices dimensions"], triangles: Int[np.ndarray, "triangles 3"]
) -> Float[np.ndarray, "triangles dimensions 2"]:
    a, b, c = (values[triangles[:, corner]] for corner in range(3))
    return np.stack([b - a, c - a], axis=-1).astype(np.float64)
