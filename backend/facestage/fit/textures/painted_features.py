"""What a face model paints on its skin: brows, lips, nostrils, a shade of hair."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from facestage.contract.arrays import Float
from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.models.mesh.surface_harmonics import laplacian_and_mass

SCALE = 0.012  # metres: what changes within less is a feature, the rest tone
SPREAD_MIN = 1e-3  # of the log albedo, below which all of the skin has one tone


def painted_features(geometry: FaceGeometry) -> Float[np.ndarray, "vertices 3"] | None:
    """Log albedo of the model's mean skin less the same diffused over SCALE along the surface, 0
    elsewhere; None: it paints nothing.

    One implicit step of the heat equation, with the cotangent Laplacian.
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
    return result
