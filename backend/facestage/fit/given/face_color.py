"""The color of the face in a texture: of its narrow part, which hair and beard hardly reach."""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.skin_tone import typology_angle
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.shading import sample_bilinear


def face_uvs(geometry: FaceGeometry) -> Float[np.ndarray, "points 2"]:
    """Where in the atlas the vertices of the narrow face are; of all that is rendered where the
    model does not say which these are.
    """
    model = geometry.model
    inside = np.zeros(len(model.vertices), bool)
    inside[model.regions.get("narrow_face", geometry.used)] = True
    rows = inside[model.triangles].all(axis=1)
    return model.uvs[np.unique(model.triangle_uvs[rows])]


def face_tone(geometry: FaceGeometry, texture: Float[np.ndarray, "texels texels 3"]) -> float:
    """The individual typology angle in degrees of the narrow face's median albedo."""
    colors = sample_bilinear(texture, face_uvs(geometry))
    return float(typology_angle(np.median(colors, axis=0)))
