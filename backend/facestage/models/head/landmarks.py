"""The 68 landmarks of the ibug scheme (Sagonas et al. 2013, "300 Faces in-the-Wild") as vertices of the head."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.face_model import SKIN
from facestage.models.head import eyes, mouth
from facestage.models.head.assemble import HeadMesh

# Subject's left, mm in the frame of the control net; the right side mirrors it.
_JAW = (
    (71.5, -6, 9), (70.5, -26, 15), (68.0, -45, 17), (63.5, -62, 20), (57.0, -79, 28), (48.0, -94, 43),
    (36.0, -105, 64), (19.0, -113.5, 79), (0, -116.5, 84),
)  # fmt: skip
_BROW = ((10, 18.5, 96), (20, 22.5, 92), (31, 24.5, 88), (42, 23, 80), (51, 17.5, 69))
_BRIDGE = ((0, 0.5, 94), (0, -14, 101), (0, -27, 109.5), (0, -40.5, 118))
_BASE = ((14.2, -50.5, 96), (7.5, -52.8, 99), (0, -54.0, 99))


def ibug68(mesh: HeadMesh) -> np.ndarray:
    """(68,) vertex indices, subject's right first as the scheme has it; the left and right ones mirror each other."""
    skin = np.unique(mesh.polygons[mesh.polygon_part == SKIN])
    skin = skin[skin >= 0]
    tree = cKDTree(mesh.vertices[skin])

    def nearest(points: tuple[tuple[float, float, float], ...], sign: float) -> list[int]:
        return [int(skin[tree.query(np.array(p) * [sign, 1, 1])[1]]) for p in points]

    jaw = nearest(_JAW, -1) + nearest(_JAW[:-1][::-1], 1)
    brows = nearest(_BROW[::-1], -1) + nearest(_BROW, 1)
    bridge = nearest(_BRIDGE, 1)
    base = nearest(_BASE, -1) + nearest(_BASE[:-1][::-1], 1)
    return np.array(jaw + brows + bridge + base + _eyes(mesh) + _lips(mesh))


def _eyes(mesh: HeadMesh) -> list[int]:
    ring = len(eyes.LID_LOOPS) + 1
    result = []
    for side in ("right", "left"):
        loop = mesh.loops[f"eye_{side}"][ring]
        n = len(loop)
        # Counterclockwise from the left of the picture; the scheme runs over the upper lid first.
        third = round(n / 6)
        corner, opposite = loop[0], loop[n // 2]
        upper = [loop[n - third], loop[n // 2 + third]]
        lower = [loop[n // 2 - third], loop[third]]
        result += [corner, *upper, opposite, *lower]
    return [int(v) for v in result]


def _lips(mesh: HeadMesh) -> list[int]:
    loops = mesh.loops["mouth"]
    outer = loops[len(mouth.OUTER_LOOPS) + 1]
    inner = loops[mouth.LIP_LOOPS]
    n = outer.shape[0]
    x = mesh.vertices[outer, 0]
    upper, lower = np.arange(n // 2 + 1, n), np.arange(1, n // 2)

    def at(loop: np.ndarray, half: np.ndarray, targets: tuple[float, ...]) -> list[int]:
        return [int(loop[half[np.abs(x[half] - t).argmin()]]) for t in targets]

    corner_right, corner_left = 0, n // 2
    ring = [int(outer[corner_right]), *at(outer, upper, (-14, -5.2, 0, 5.2, 14)), int(outer[corner_left])]
    ring += at(outer, lower, (14, 6.5, 0, -6.5, -14))
    inside = at(inner, upper, (-22.5, -7.5, 0, 7.5, 22.5)) + at(inner, lower, (7.5, 0, -7.5))
    return ring + inside
