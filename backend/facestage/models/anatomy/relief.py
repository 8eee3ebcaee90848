"""Relief: what a person's skin has beyond the shapes of a face model, as smooth fields along its
normals.

The fields are a Gaussian process over the face's skin with a covariance that falls off as a
Gaussian of the distance along it: eigenfunctions of the Laplacian, whose spectrum is
exp(-length^2 eigenvalue / 2) (Rasmussen and Williams 2006, "Gaussian Processes for Machine
Learning", eq. 4.11; on a surface Borovitskiy et al. 2020, "Matern Gaussian Processes on Riemannian
Manifolds").
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.arrays import Float32
from facestage.contract.face_model import SKIN, FaceModel
from facestage.models.mesh.surface import vertex_normals
from facestage.models.mesh.surface_harmonics import surface_harmonics

# Standard deviation in mm, half of what no coefficient of a model says of a person
# (fit/trust/vertex_certainty.py): of one scanned head it was as good as all of that, and of two
# photos of a person of the model's own it harmed the second one less (docs/several-photos.md).
RELIEF_MM = 0.4
# Distance in mm over which relief varies, and how many fields say it.
LENGTH_MM, MODES = 12.0, 200
# Vertices of the face's skin that it takes for each field.
VERTICES_PER_MODE = 8
# Distance in mm from the border of the face within which relief fades.
BORDER_MM = 12.0


def relief_basis(model: FaceModel) -> Float32[np.ndarray, "reliefs vertices 3"]:
    """Motion in metres by one standard deviation of each field, smoothest first; of a mesh too
    coarse for any, none.
    """
    face = np.zeros(len(model.vertices), bool)
    face[model.regions.get("face", slice(None))] = True
    skin = model.triangles[model.triangle_part == SKIN]
    triangles = skin[face[skin].all(axis=1)]
    covered = np.zeros(len(face), bool)
    covered[triangles] = True
    count = min(MODES, int(covered.sum()) // VERTICES_PER_MODE)
    if not count:
        return np.zeros((0, len(face), 3), np.float32)
    millimetres = 1e3 * model.vertices.astype(np.float64)
    fields, eigenvalues = surface_harmonics(millimetres, triangles, covered, count)
    fields *= np.exp(-0.25 * LENGTH_MM**2 * eigenvalues)[:, None]
    deviation = np.sqrt((fields[:, covered] ** 2).sum(axis=0).mean())
    border = skin[~face[skin].all(axis=1)]
    border = np.unique(border[face[border]])
    inside = np.ones(len(face))
    if len(border):
        distance = cKDTree(millimetres[border]).query(millimetres)[0]
        inside = np.clip(distance / BORDER_MM, 0.0, 1.0)
        inside = inside**2 * (3.0 - 2.0 * inside)
    heights = 1e-3 * RELIEF_MM / deviation * fields * inside
    normals = vertex_normals(millimetres, skin)
    return (heights[:, :, None] * normals).astype(np.float32)
