"""The flesh in the corners of the eyes, where the face model has some: the caruncle and the fold
that leads to the white.

It is a few pixels of a photo, among lashes and the shadows of lids that the fit does not have: what
a photo seems to say of it is dark and as often blue as red. So it keeps the model's colors, beside
those of the white of the eyes, which it goes over into.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Bool, Float32
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.atlas import Atlas

REGION = "eye_corners"  # of the face model


def flesh_of(geometry: FaceGeometry) -> Bool[np.ndarray, " vertices"]:
    """The vertices of the rendered mesh that are such flesh."""
    result = np.zeros(len(geometry.mean), bool)
    result[geometry.new_index[geometry.model.regions.get(REGION, np.zeros(0, int))]] = True
    return result


def keep_flesh(
    detail: Float32[np.ndarray, "size size 3"], atlas: Atlas, geometry: FaceGeometry
) -> None:
    """Take off the flesh what is to be added to the model's log albedo, in place; up to the
    margins of the lids less and less of it.
    """
    flesh = flesh_of(geometry)
    near = atlas.on(flesh[atlas.triangles].any(axis=1))
    if not len(near):
        return
    share = atlas.at(near, flesh.astype(float))
    detail.reshape(-1, 3)[atlas.place(near)] *= (1 - share)[:, None].astype(np.float32)
