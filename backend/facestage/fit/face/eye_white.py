"""Where the whites of the eyes are on the mesh, and whether a photo shows them."""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.contract.face_model import EYES
from facestage.contract.files.color import REC709
from facestage.fit.face.geometry import FaceGeometry

# Luminance of the albedo of what the model paints as iris, at most.
IRIS_MAX = 0.25
# The skin's red over blue exceeds that of an open eye by so much at least, of the logarithm; or an
# open eye is so much lighter than dark skin, which may be grey.
PALER_MIN, LIGHTER_MIN = 0.15, 0.8


def eye_white(geometry: FaceGeometry) -> Bool[np.ndarray, " vertices"]:
    """The vertices that the model paints as white; none where eyeballs have one color, of which
    nobody can say what it is.
    """
    luminance = np.exp(geometry.log_albedo) @ np.array(REC709)
    eyes = np.zeros(len(luminance), bool)
    eyes[geometry.triangles[geometry.triangle_part == EYES]] = True
    dark = luminance < IRIS_MAX
    return eyes & ~dark if (eyes & dark).any() else np.zeros_like(eyes)


def eye_is_open(white: Float[np.ndarray, " 3"], skin: Float[np.ndarray, "pixels 3"]) -> bool:
    """Whether what should be the ``white`` of an eye is less red than the ``skin``'s median under
    the same light, or much lighter: a lid is neither. Linear RGB; without skin it is not known.
    """
    if not len(skin):
        return False
    of_skin = np.log(np.maximum(np.median(skin, axis=0), 1e-6))
    of_white = np.log(np.maximum(white, 1e-6))
    less_red = (of_skin[0] - of_skin[2]) - (of_white[0] - of_white[2])
    return bool(less_red > PALER_MIN or (of_white - of_skin).mean() > LIGHTER_MIN)
