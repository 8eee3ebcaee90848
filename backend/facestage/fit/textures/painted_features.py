"""What a face model paints on its skin: brows, lips, nostrils, a shade of hair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from facestage.contract.arrays import Float, Int
from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.shading import Surface
from facestage.models.mesh.surface_harmonics import laplacian_and_mass

SCALE = 0.012  # metres: what changes within less is a feature, the rest tone
WHOLE_MIN = 1e-3  # of the most, below which there is no paint to be taken off
SPREAD_MIN = 1e-3  # of the log albedo, below which all of the skin has one tone


@dataclass(frozen=True)
class Paint:
    """The model's paint, and the surface that it is on."""

    # (vertices, 3) log albedo of the model's mean skin less the same diffused over SCALE, 0
    # elsewhere
    features: Float[np.ndarray, "vertices 3"]
    used: Int[np.ndarray, " skin"]  # the vertices of the skin
    # One implicit step of the heat equation over SCALE: of masses (skin, ...) to values.
    diffused: Callable[[np.ndarray], np.ndarray]

    def contradicted(
        self,
        surface: Surface,
        residual: Float[np.ndarray, "pixels 3"],
        weight: Float[np.ndarray, " pixels"],
    ) -> Float[np.ndarray, "vertices 3"]:
        """The paint as far as the photo takes it off: of each vertex the share that a least-squares
        fit of the paint to the ``residual`` (log of photo over model) around it has, between none
        and all. Where the photo's brows are the model's, they are left as sharp as they are.
        """
        there = surface.of_vertices(self.features)
        sums = []
        for other in (-residual, there):
            each = (weight * (other * there).sum(axis=1))[:, None] * surface.weights
            sums.append(np.bincount(surface.corners.ravel(), each.ravel(), len(self.features)))
        taken, whole = (self.diffused(each[self.used]) for each in sums)
        share = np.zeros(len(self.features))
        least = max(WHOLE_MIN * float(whole.max(initial=0.0)), float(np.finfo(float).tiny))
        share[self.used] = np.clip(taken / np.maximum(whole, least), 0.0, 1.0)
        return share[:, None] * self.features


def painted_features(geometry: FaceGeometry) -> Paint | None:
    """What the model paints on the skin; None: nothing.

    With the cotangent Laplacian.
    """
    faces = geometry.triangles[geometry.triangle_part == SKIN]
    used, faces = np.unique(faces, return_inverse=True)
    logs = geometry.log_albedo[used].astype(np.float64)
    if not len(used) or np.ptp(logs, axis=0).max() < SPREAD_MIN:
        return None
    laplacian, mass = laplacian_and_mass(geometry.mean[used], faces.reshape(-1, 3))
    step = splu((sp.diags(mass) + SCALE**2 * laplacian).tocsc())
    result = np.zeros_like(geometry.log_albedo)
    result[used] = logs - step.solve(mass[:, None] * logs)
    return Paint(result, used, step.solve)
