"""The shade of hair that a face model paints on its scalp: it begins where a photo's bare skin
ends.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from facestage.contract.arrays import Float
from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.shading import Surface
from facestage.models.mesh.surface_harmonics import laplacian_and_mass

SCALP = "scalp"  # the region of the face model
THINNING = 0.016  # metres beyond the region within which its hair may go over into skin
SOFTNESS = 0.008  # metres over which a hairline that a photo moves is soft
SEEN_SHARE = 0.3  # of how well skin is seen on average, from which on half of it is known


def hair_shade(geometry: FaceGeometry) -> Float[np.ndarray, "vertices 3"]:
    """By how much hair that the model paints on its scalp darkens its log albedo: 0 or less.

    Skin below hair is the harmonic extension of the skin around it.
    """
    result = np.zeros((len(geometry.mean), 3))
    used, faces = np.unique(geometry.triangles[geometry.triangle_part == SKIN], return_inverse=True)
    hair = np.isin(used, geometry.new_index[geometry.model.regions.get(SCALP, np.zeros(0, int))])
    if not hair.any():
        return result
    points = geometry.mean[used]
    laplacian, _ = laplacian_and_mass(points, faces.reshape(-1, 3))
    below = cKDTree(points[hair]).query(points)[0] < THINNING
    logs = geometry.log_albedo[used].astype(np.float64)
    rows = laplacian[below]
    bare = splu(rows[:, below].tocsc()).solve(-(rows[:, ~below] @ logs[~below]))
    result[used[below]] = np.minimum(logs[below] - bare, 0.0)
    return result


def bared(
    geometry: FaceGeometry,
    surface: Surface,
    weight: Float[np.ndarray, " pixels"],
    shade: Float[np.ndarray, "vertices 3"],
) -> Float[np.ndarray, "vertices 3"]:
    """What takes the model's ``shade`` of hair off its log albedo where pixels of ``weight`` at
    ``surface`` show skin, and softly beside them.
    """
    result = np.zeros_like(shade)
    if not shade.any() or weight.sum() <= 0:
        return result
    used, faces = np.unique(geometry.triangles[geometry.triangle_part == SKIN], return_inverse=True)
    laplacian, mass = laplacian_and_mass(geometry.mean[used], faces.reshape(-1, 3))
    each = weight[:, None] * surface.weights
    seen = np.bincount(surface.corners.ravel(), each.ravel(), len(geometry.mean))[used]
    usual = np.average(seen / mass, weights=seen)
    spread = splu((sp.diags(mass) + SOFTNESS**2 * laplacian).tocsc())
    known = spread.solve(mass * seen / (seen + SEEN_SHARE * usual * mass))
    # At a straight border of what is seen, half is known.
    result[used] = -np.clip(2.0 * known, 0.0, 1.0)[:, None] * shade[used]
    return result
