"""Where the face is on a mesh that only brings landmarks, and the colors of eyes, teeth and
mouth.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.face_model import EYES, MOUTH, OTHER, TEETH

IRIS_RADIUS, PUPIL_RADIUS = 0.0059, 0.0021  # m
PART_ALBEDO = {
    MOUTH: (0.20, 0.06, 0.05),
    TEETH: (0.60, 0.55, 0.45),
    EYES: (0.62, 0.58, 0.54),
    OTHER: (0.3, 0.3, 0.3),
}
# Of what lies in the mouth; how near to the teeth gums end, m.
GUM, TONGUE, PALATE = (0.42, 0.18, 0.16), (0.36, 0.13, 0.12), (0.28, 0.10, 0.09)
_GUM_SURE, _GUM_NONE = 0.004, 0.007
IRIS, PUPIL = (0.10, 0.07, 0.05), (0.01, 0.01, 0.01)
_CHIN, _RIGHT_EAR, _LEFT_EAR, _BROWS, _RIGHT_CORNER, _LEFT_CORNER = 8, 0, 16, slice(17, 27), 36, 45


def landmark_points(vertices: np.ndarray, table: np.ndarray) -> np.ndarray:
    """(m, 3) positions of a landmark table (m, 6): three vertex indices, three barycentric
    weights.
    """
    return np.einsum("mk,mkc->mc", table[:, 3:], vertices[table[:, :3].astype(int)])


def face_regions(
    vertices: np.ndarray, skin: np.ndarray, table: np.ndarray
) -> dict[str, np.ndarray]:
    """The regions narrow_face, face and skin as vertex indices, from the 68 ibug landmarks.

    vertices (n, 3) in the model's axes (+Y up, +Z forward), any origin; skin (n,) bool; table (68,
    6). The narrow face runs from chin to brows and sideways to the outer corners of the eyes; the
    face to the forehead and before the ears.
    """
    points = landmark_points(vertices, table)
    x, y, z = vertices.T
    width = points[_LEFT_CORNER, 0] - points[_RIGHT_CORNER, 0]
    chin, brow = points[_CHIN, 1], points[_BROWS, 1].max()
    height = brow - chin
    low = chin - 0.03 * height
    narrow = (x > points[_RIGHT_CORNER, 0] - 0.1 * width) & (
        x < points[_LEFT_CORNER, 0] + 0.1 * width
    )
    narrow &= (
        (y > low)
        & (y < brow + 0.05 * height)
        & (z > points[[_RIGHT_CORNER, _LEFT_CORNER], 2].min() - 0.4 * width)
    )
    ear = points[[_RIGHT_EAR, _LEFT_EAR]]
    face = (
        (x > ear[:, 0].min())
        & (x < ear[:, 0].max())
        & (z > ear[:, 2].mean())
        & (y < brow + 0.45 * height)
    )
    # Under the jaw the border rises from the chin to the ears.
    depth = np.clip((points[_CHIN, 2] - z) / max(points[_CHIN, 2] - ear[:, 2].mean(), 1e-6), 0, 1)
    face &= y > low + depth * (ear[:, 1].mean() - low) * 0.7
    narrow &= skin
    face = (face & skin) | narrow
    return {
        "narrow_face": np.flatnonzero(narrow).astype(np.int32),
        "face": np.flatnonzero(face).astype(np.int32),
        "skin": np.flatnonzero(skin).astype(np.int32),
    }


def eyeball_colors(ball: np.ndarray) -> np.ndarray:
    """(v, 3) linear colors of one eyeball's vertices (v, 3) m that looks along +Z: sclera, iris and
    pupil.
    """
    colors = np.tile(np.array(PART_ALBEDO[EYES]), (len(ball), 1))
    centre = 0.5 * (ball.min(0) + ball.max(0))
    radius = np.hypot(*(ball[:, :2] - centre[:2]).T)
    front = ball[:, 2] > centre[2]
    colors[front & (radius < IRIS_RADIUS)] = IRIS
    colors[front & (radius < PUPIL_RADIUS)] = PUPIL
    return colors


def mouth_colors(inside: np.ndarray, teeth: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """(v, 3) linear colors of the vertices (v, 3) m inside a mouth that are gums, tongue and palate
    in one piece: gums around ``teeth`` (t, 3) m; the tongue, which the jaw takes along by more than
    a third of the largest of ``moved`` (v,), what each vertex moves when it opens.
    """
    tongue = moved > moved.max() / 3
    colors = np.where(tongue[:, None], TONGUE, PALATE)
    distance = cKDTree(teeth).query(inside)[0]
    gum = np.interp(distance, (_GUM_SURE, _GUM_NONE), (1.0, 0.0))[:, None]
    return np.asarray(gum * np.array(GUM) + (1 - gum) * colors)


def outward(vertices: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The triangles, turned over together when most of a head's surface faces inwards."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    normal = np.cross(b - a, c - a)
    # The middle of a head, or half its depth behind a mask.
    middle = 0.5 * (vertices.min(0) + vertices.max(0)) - [0, 0, 0.25 * np.ptp(vertices[:, 0])]
    facing = np.einsum("ij,ij->i", normal, (a + b + c) / 3 - middle).sum()
    return triangles if facing >= 0 else np.ascontiguousarray(triangles[:, ::-1])


def quads_of(triangles: np.ndarray) -> np.ndarray:
    """(t, 4) int32 polygons of triangles: the fourth corner is -1."""
    return np.concatenate([triangles, np.full((len(triangles), 1), -1)], axis=1).astype(np.int32)
