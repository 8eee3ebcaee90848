"""From the mesh's 478 points to the 68 of the ibug scheme (Sagonas et al. 2013, "300 Faces
in-the-Wild").

Each is a point on an edge of the mesh. Corners of eyes and mouth, lids, the nose's tip and base are
the mesh's own points. Between such corners ibug spaces its points evenly (jaw, brows, the bridge of
the nose, lips), which the mesh does not: there they lie on the edge where the face models of this
project, and ICT-FaceKit's, have them on the mean face. The jaw is an approximation besides: ibug's
is the outline in the picture, the mesh's oval a line on the skin.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks

SOURCE, TARGET = "mediapipe478", "ibug68"
# Two points of the mesh and the second one's share, from the person's right to the left as the
# scheme counts. fmt: off
JAW = (
    (162, 127, 0.85),
    (234, 93, 0.2),
    (93, 132, 0.45),
    (132, 58, 0.55),
    (58, 172, 0.85),
    (136, 150, 0.5),
    (150, 149, 1.0),
    (176, 148, 0.6),
    (152, 152, 0.0),
    (400, 377, 0.6),
    (379, 378, 1.0),
    (365, 379, 0.5),
    (288, 397, 0.85),
    (361, 288, 0.55),
    (323, 361, 0.45),
    (454, 323, 0.2),
    (389, 356, 0.85),
)
BROWS = (
    (70, 63, 0.25),
    (63, 105, 0.3),
    (105, 66, 0.3),
    (66, 107, 0.25),
    (107, 9, 0.2),
    (336, 9, 0.2),
    (296, 336, 0.25),
    (334, 296, 0.3),
    (293, 334, 0.3),
    (300, 293, 0.25),
)
NOSE = (
    (168, 168, 0.0),
    (6, 197, 0.6),
    (195, 5, 0.3),
    (4, 4, 0.0),
    (240, 240, 0.0),
    (97, 97, 0.0),
    (2, 2, 0.0),
    (326, 326, 0.0),
    (460, 460, 0.0),
)
EYES = tuple(
    (point, point, 0.0) for point in (33, 160, 158, 133, 153, 144, 362, 385, 387, 263, 373, 380)
)
LIPS = (
    (61, 61, 0.0),
    (40, 39, 0.75),
    (37, 37, 0.0),
    (0, 0, 0.0),
    (267, 267, 0.0),
    (270, 269, 0.75),
    (291, 291, 0.0),
    (321, 405, 0.6),
    (314, 314, 0.0),
    (17, 17, 0.0),
    (84, 84, 0.0),
    (91, 181, 0.6),
    (78, 78, 0.0),
    (81, 82, 0.6),
    (13, 13, 0.0),
    (311, 312, 0.6),
    (308, 308, 0.0),
    (402, 317, 0.6),
    (14, 14, 0.0),
    (178, 87, 0.6),
)
# fmt: on
TABLE = (*JAW, *BROWS, *NOSE, *EYES, *LIPS)
FIRST, SECOND = (np.array([row[column] for row in TABLE], np.int64) for column in (0, 1))
SHARE = np.array([row[2] for row in TABLE])


def to_ibug68(landmarks: Landmarks) -> Landmarks:
    """The ibug68 landmarks of mediapipe478 ones, visible where the points they come from are."""
    share = SHARE[:, None]
    points = (1 - share) * landmarks.points[FIRST] + share * landmarks.points[SECOND]
    return Landmarks(TARGET, points, landmarks.visible[FIRST] & landmarks.visible[SECOND])
