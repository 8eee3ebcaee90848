"""From the mesh's 478 points to the 68 of the ibug scheme (Sagonas et al. 2013, "300 Faces in-the-Wild").

Brows, nose, eyes and lips are the mesh's own points. The jaw is an approximation: ibug's is the outline in the
picture, while the mesh's oval lies on fixed places of the skin. Its points are placed along the oval, from above the
ear to the chin, between even spacing and where ICT-FaceKit has them.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks

SOURCE, TARGET = "mediapipe478", "ibug68"
# fmt: off
# Two neighbors on the oval and the second one's share, from the person's right ear to the chin and on to the left.
JAW = (
    (162, 127, 0.85), (234, 93, 0.2), (93, 132, 0.45), (132, 58, 0.55), (58, 172, 0.85), (136, 150, 0.5),
    (150, 149, 1.0), (176, 148, 0.6), (152, 152, 0.0), (400, 377, 0.6), (379, 378, 1.0), (365, 379, 0.5),
    (288, 397, 0.85), (361, 288, 0.55), (323, 361, 0.45), (454, 323, 0.2), (389, 356, 0.85),
)
BROWS = (70, 63, 105, 66, 107, 336, 296, 334, 293, 300)
NOSE = (168, 197, 5, 4, 75, 97, 2, 326, 305)
EYES = (33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380)
LIPS = (61, 39, 37, 0, 267, 269, 291, 405, 314, 17, 84, 181, 78, 82, 13, 312, 308, 317, 14, 87)
# fmt: on
FIRST = np.array([pair[0] for pair in JAW] + [*BROWS, *NOSE, *EYES, *LIPS])
SECOND = np.array([pair[1] for pair in JAW] + [*BROWS, *NOSE, *EYES, *LIPS])
SHARE = np.array([pair[2] for pair in JAW] + [0.0] * (len(FIRST) - len(JAW)))


def to_ibug68(landmarks: Landmarks) -> Landmarks:
    """The ibug68 landmarks of mediapipe478 ones, visible where the points they come from are."""
    share = SHARE[:, None]
    points = (1 - share) * landmarks.points[FIRST] + share * landmarks.points[SECOND]
    return Landmarks(TARGET, points, landmarks.visible[FIRST] & landmarks.visible[SECOND])
