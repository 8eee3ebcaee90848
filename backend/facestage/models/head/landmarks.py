"""The 68 landmarks of the ibug scheme (Sagonas et al. 2013, "300 Faces in-the-Wild") as vertices of
the head.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from facestage.contract.face_model import SKIN
from facestage.models.head import eyes, mouth
from facestage.models.head.assemble import HeadMesh
from facestage.models.head.features import BROW_LINE

# Subject's left, mm in the frame of the control net; the right side mirrors it.
_JAW = (
    (71.5, -6, 9), (70.5, -26, 15), (68.0, -45, 17), (63.5, -62, 20), (57.0, -79, 28),
    (48.0, -94, 43),
    (36.0, -105, 64), (19.0, -113.5, 79), (0, -116.5, 84),
)  # fmt: skip
_BRIDGE = ((0, 0.5, 94), (0, -14, 101), (0, -28.8, 110.5), (0, -40.5, 118))
_BASE = ((14.2, -49.8, 96), (6.3, -53.2, 99), (0, -53.0, 99))


def ibug68(mesh: HeadMesh) -> np.ndarray:
    """(68,) vertex indices, subject's right first as the scheme has it; the left and right ones
    mirror each other.
    """
    skin = np.unique(mesh.polygons[mesh.polygon_part == SKIN])
    skin = skin[skin >= 0]
    tree = cKDTree(mesh.vertices[skin])

    def nearest(points: tuple[tuple[float, float, float], ...], sign: float) -> list[int]:
        return [int(skin[tree.query(np.array(p) * [sign, 1, 1])[1]]) for p in points]

    jaw = nearest(_JAW, -1) + nearest(_JAW[:-1][::-1], 1)
    brow = _on_front(mesh, BROW_LINE)
    brows = nearest(brow[::-1], -1) + nearest(brow, 1)
    bridge = nearest(_BRIDGE, 1)
    base = nearest(_BASE, -1) + nearest(_BASE[:-1][::-1], 1)
    return np.array(jaw + brows + bridge + base + _eyes(mesh) + _lips(mesh))


def _on_front(
    mesh: HeadMesh, points: tuple[tuple[float, float], ...]
) -> tuple[tuple[float, float, float], ...]:
    """Vertices of the front of the head nearest to front view points."""
    front = mesh.vertices[mesh.grid[mesh.grid >= 0]]
    front = front[front[:, 2] > 40.0]
    return tuple((p[0], p[1], p[2]) for p in front[cKDTree(front[:, :2]).query(points)[1]])


def _eyes(mesh: HeadMesh) -> list[int]:
    result = []
    for side in ("right", "left"):
        loop = mesh.loops[f"eye_{side}"][eyes.MARGIN]
        n = len(loop)
        # Counterclockwise from the left of the picture; the scheme runs over the upper lid first.
        # Annotators place the two points at the edges of the iris: the inner one further from its
        # corner.
        outer = round(n / 6)
        first, second = (outer, outer + 1) if side == "right" else (outer + 1, outer)
        corner, opposite = loop[0], loop[n // 2]
        upper = [loop[n - first], loop[n // 2 + second]]
        lower = [loop[n // 2 - second], loop[first]]
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
    ring = [
        int(outer[corner_right]),
        *at(outer, upper, (-14, -5.2, 0, 5.2, 14)),
        int(outer[corner_left]),
    ]
    ring += at(outer, lower, (14, 6.5, 0, -6.5, -14))
    inside = at(inner, upper, (-22.5, -7.5, 0, 7.5, 22.5)) + at(inner, lower, (7.5, 0, -7.5))
    return ring + inside
