"""From the mesh's 478 points to the 68 of the ibug scheme (Sagonas et al. 2013, "300 Faces in-the-Wild").

Brows, nose, eyes and lips are the mesh's own points. The jaw is an approximation: ibug's is the outline in the
picture, the mesh's oval lies on fixed places of the skin, a little inside it on a turned head.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks

SOURCE, TARGET = "mediapipe478", "ibug68"
# fmt: off
JAW = (127, 234, 93, 132, 58, 136, 150, 176, 152, 400, 379, 365, 288, 361, 323, 454, 356)
BROWS = (70, 63, 105, 66, 107, 336, 296, 334, 293, 300)
NOSE = (168, 197, 5, 4, 75, 97, 2, 326, 305)
EYES = (33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380)
LIPS = (61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181, 78, 82, 13, 312, 308, 317, 14, 87)
# fmt: on
POINTS = np.array(JAW + BROWS + NOSE + EYES + LIPS)


def to_ibug68(landmarks: Landmarks) -> Landmarks:
    """The ibug68 landmarks of mediapipe478 ones, visible where their source is."""
    return Landmarks(TARGET, landmarks.points[POINTS], landmarks.visible[POINTS])
