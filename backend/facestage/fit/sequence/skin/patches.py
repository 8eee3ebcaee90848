"""The face's skin in patches of about the same size, over which color is averaged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.arrays import Float, Int
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.sequence.skin.leftover import Leftover

PATCHES = 256  # of a centimetre
# Linear radiance below which a pixel says nothing of color, and log radiance beyond which what is
# left over is no skin.
DIM, FAR = 0.02, 0.4


@dataclass(frozen=True, eq=False)
class PatchSeen:
    """The means of a frame's pixels over each patch."""

    weight: Float[np.ndarray, " patches"]  # pixels
    residual: Float[np.ndarray, "patches 3"]  # of log radiance
    by_log_albedo: Float[np.ndarray, "patches 3"]


@dataclass(frozen=True, eq=False)
class Patches:
    """Which patch each rendered vertex lies in; -1: none, for it is no skin of the face."""

    of_vertex: Int[np.ndarray, " vertices"]
    count: int

    @classmethod
    def of(cls, geometry: FaceGeometry, count: int = PATCHES) -> Patches:
        """Around points that lie as far from each other as they can."""
        inside = geometry.fitted_vertices
        points = geometry.mean[inside]
        count = min(count, len(points))
        chosen, distance = [0], np.linalg.norm(points - points[0], axis=1)
        for _ in range(count - 1):
            chosen.append(int(distance.argmax()))
            away = np.linalg.norm(points - points[chosen[-1]], axis=1)
            distance = np.minimum(distance, away)
        result = np.full(len(geometry.mean), -1)
        result[inside] = cKDTree(points[chosen]).query(points)[1]
        return cls(result, count)

    def means(
        self, values: Float[np.ndarray, "functions vertices"]
    ) -> Float[np.ndarray, "patches functions"]:
        """Of functions on the vertices."""
        inside = self.of_vertex >= 0
        where = self.of_vertex[inside]
        total = [np.bincount(where, each[inside], self.count) for each in values]
        return np.stack(total, axis=1) / np.bincount(where, minlength=self.count)[:, None]

    def seen(self, frame: Leftover) -> PatchSeen:
        """What a frame has left over."""
        surface, residual = frame.image.surface, frame.residual
        nearest = surface.weights.argmax(axis=1)
        patch = self.of_vertex[surface.corners[np.arange(len(nearest)), nearest]]
        weight = frame.clear * ~frame.clipped.any(axis=1) * (frame.photo.mean(axis=1) > DIM)
        weight = weight * (patch >= 0) / (1.0 + (np.abs(residual).max(axis=1) / FAR) ** 4)
        patch = np.maximum(patch, 0)
        total = np.bincount(patch, weight, self.count)

        def mean(values: Float[np.ndarray, "pixels 3"]) -> Float[np.ndarray, "patches 3"]:
            sums = [np.bincount(patch, weight * each, self.count) for each in values.T]
            return np.stack(sums, axis=1) / np.maximum(total, 1e-9)[:, None]

        return PatchSeen(total, mean(residual), mean(frame.by_log_albedo))
