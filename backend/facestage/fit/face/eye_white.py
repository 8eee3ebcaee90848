"""Where the whites of the eyes are on the mesh."""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Bool
from facestage.contract.face_model import EYES
from facestage.contract.files.color import REC709
from facestage.fit.face.geometry import FaceGeometry

# Luminance of the albedo of what the model paints as iris, at most.
IRIS_MAX = 0.25


def eye_white(geometry: FaceGeometry) -> Bool[np.ndarray, " vertices"]:
    """The vertices that the model paints as white; none where eyeballs have one color, of which
    nobody can say what it is.
    """
    luminance = np.exp(geometry.log_albedo) @ np.array(REC709)
    eyes = np.zeros(len(luminance), bool)
    eyes[geometry.triangles[geometry.triangle_part == EYES]] = True
    dark = luminance < IRIS_MAX
    return eyes & ~dark if (eyes & dark).any() else np.zeros_like(eyes)
