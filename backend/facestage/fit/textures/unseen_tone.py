"""The tone of skin that no photo shows: it follows what is seen around it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from facestage.contract.arrays import Float
from facestage.contract.face_model import SKIN
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.shading import Surface
from facestage.models.mesh.surface_harmonics import laplacian_and_mass

SCALE = 0.02  # metres: what changes within less is no tone
REACH = 0.1  # metres beyond what is seen over which its own tone gives way to that of all seen skin
FEATURE_MAX = 0.15  # departure of log albedo from which on a pixel shows brows or lips, not tone


def unseen_tone(
    geometry: FaceGeometry,
    surface: Surface,
    target: Float[np.ndarray, "pixels 3"],
    weight: Float[np.ndarray, " pixels"],
    feature: Float[np.ndarray, " pixels"],
    scale: float = SCALE,
) -> Float[np.ndarray, "vertices 3"]:
    """What is to be added to the model's log albedo so that its tone is that of the skin seen: a
    screened membrane over the skin, 0 on all else.

    Minimises sum_p w_p |x(p) - y_p|^2 + k int |grad x|^2 + k / REACH^2 int |x - y|^2 with y the
    mean of ``target`` (log of photo over model, at the pixels' ``surface``) and k that of a length
    of ``scale`` (metres) where pixels are seen well: the screened Poisson equation (Bhat 2008,
    "Fourier Analysis of the 2D Screened Poisson Equation for Gradient Domain Problems", eq. 3)
    with no gradient of its own, so that the model's details stay as they are. ``feature`` as of
    Shown.
    """
    result = np.zeros((len(geometry.mean), 3))
    weight = weight / (1.0 + (feature / FEATURE_MAX) ** 2)
    used, faces = np.unique(geometry.triangles[geometry.triangle_part == SKIN], return_inverse=True)
    if not len(used) or weight.sum() <= 0:
        return result
    laplacian, mass = laplacian_and_mass(geometry.mean[used], faces.reshape(-1, 3))
    each = weight[:, None] * surface.weights
    corners, count = surface.corners.ravel(), len(geometry.mean)
    seen = np.bincount(corners, each.ravel(), count)[used]
    middle = weight @ target / weight.sum()
    right = np.stack(
        [
            np.bincount(corners, (each * (target[:, c] - middle[c])[:, None]).ravel(), count)
            for c in range(3)
        ],
        axis=1,
    )[used]
    density = np.average(seen / mass, weights=seen)
    stiffness = density * scale**2
    system = sp.diags(seen + stiffness / REACH**2 * mass) + stiffness * laplacian
    result[used] = middle + splu(system.tocsc()).solve(right)
    return result
