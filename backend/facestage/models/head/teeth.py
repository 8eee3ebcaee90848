"""Two rows of teeth with their gums: strips along the dental arches, one crown after the other.

Crown sizes after Nelson and Ash 2010, "Wheeler's Dental Anatomy"; the upper incisors end two
millimetres below the line where the lips meet, as they show when lips part at rest (Vig and Brundo
1978, "The kinetics of anterior tooth display"). Gums fill two fifths of the gaps (Chu et al. 2009,
"Papilla proportions in the maxillary anterior dentition"). How edges are rounded is by eye.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Crown:
    """One tooth; mm. ``rise``: of its biting edge above (upper row) or below (lower row) that of
    the central incisor. ``corners``: how much further that edge rises towards its neighbour on the
    midline's side, and on the other. ``level``: where the edge is level, in shares of the width.
    """

    width: float
    height: float
    rise: float
    corners: tuple[float, float]
    level: tuple[float, float]


@dataclass(frozen=True)
class Row:
    """One dental arch, from the midline to the second molar; mm.

    inset: how far the row stands behind the upper one. edge: height of the incisal edge. lean: how
    far the front teeth's gums stand back, by mm from their edges.
    """

    crowns: tuple[Crown, ...]
    inset: float
    edge: float
    away: float  # the direction of the gum: 1 up, -1 down
    lean: float = 0.0


UPPER = Row(
    (
        Crown(8.6, 10.2, 0.0, (0.2, 0.45), (0.14, 0.82)),
        Crown(6.6, 9.0, 0.6, (0.3, 0.6), (0.20, 0.76)),
        Crown(7.6, 10.0, 0.0, (1.3, 1.7), (0.40, 0.52)),
        Crown(7.1, 8.8, 0.5, (1.3, 1.3), (0.42, 0.58)),
        Crown(6.8, 8.2, 0.8, (1.0, 1.0), (0.40, 0.60)),
        Crown(10.2, 7.6, 0.9, (0.9, 0.9), (0.25, 0.75)),
        Crown(9.2, 7.2, 1.1, (0.8, 0.8), (0.25, 0.75)),
    ),
    inset=0.0,
    edge=-75.1,
    away=1.0,
)
LOWER = Row(
    (
        Crown(5.3, 8.6, 0.0, (0.15, 0.2), (0.15, 0.85)),
        Crown(5.9, 9.0, 0.0, (0.2, 0.35), (0.15, 0.80)),
        Crown(6.8, 10.0, 0.0, (0.9, 1.3), (0.38, 0.52)),
        Crown(7.0, 8.8, 0.5, (1.1, 1.2), (0.40, 0.60)),
        Crown(7.1, 8.2, 0.8, (0.9, 0.9), (0.35, 0.65)),
        Crown(11.0, 7.6, 0.9, (0.8, 0.8), (0.25, 0.75)),
        Crown(10.4, 7.2, 0.7, (0.8, 0.8), (0.25, 0.75)),
    ),
    inset=2.8,
    edge=-73.3,
    away=-1.0,
    lean=0.3,
)
FRONT_Z = 92.4  # of the upper incisors: just behind the lips
_ARCH_HALF_WIDTH, _ARCH_DEPTH, _ARCH_POWER = 27.8, 46.4, 2.25

# Columns of a crown: the gap before it, its two ends, and between them where its edge is level, or
# near to that at the neck; shares of its width.
COLUMNS = 5
_END = 0.055
_AT_NECK = (0.0, _END, 0.2, 0.8, 1 - _END, 1.0)
_EDGE, _NECK = 0.2, 0.6  # shares of the height
# mm: walls of a gap that meet at less than a right angle keep all light from it, because shadow
# rays begin beyond the other wall.
_GAP_DEPTH = 0.1
# By so much of its height gums reach down beside a crown, and its edge's corners round it off; and
# how much less deep its neck lies there.
_PAPILLA, _ROUNDED, _FLUSH = 0.4, 0.45, 0.75
# Rows from the gum over the biting edge to the back: share of the crown's height, mm inward, part.
GUM_ROWS = 2
PROFILE_ROWS = (
    (1.45, 1.6),
    (1.03, 0.3),
    (0.97, 0.5),
    (0.53, 0.0),
    (0.2, 0.25),
    (0.0, 0.7),
    (0.0, 1.7),
    (0.8, 5.0),
)
PROFILE = len(PROFILE_ROWS)


def strip(row: Row) -> tuple[np.ndarray, np.ndarray]:
    """(PROFILE, m, 3) mm, from the subject's right to the left, and how deep in a gap each column
    (m,) lies, 0..1.
    """
    columns = _columns(row)
    rows = []
    for share, inside in PROFILE_ROWS:
        across = columns.across(share)
        middle = np.sin(np.pi * across)  # 1 in the middle of a crown, 0 in the gaps
        arch, inward = _arch(columns.start + columns.width * across, row.inset)
        # Where gums meet crowns they reach down between them, and lie flush with them there.
        papilla = (1 - middle) ** 2.5 * (0.9 < share < 1.2)
        depth = inside * (1 - _FLUSH * papilla)
        rounding = columns.corner * max(1 - share / _ROUNDED, 0.0)
        up = row.away * (columns.rise + (share - _PAPILLA * papilla) * columns.height + rounding)
        bulge = 0.5 * (1 - middle) + _GAP_DEPTH * columns.gap * (share < 1.0)
        point = np.stack([arch[:, 0], row.edge + up, arch[:, 1]], axis=-1)
        point[:, [0, 2]] += (depth + bulge)[:, None] * inward
        point[:, 2] -= row.lean * np.abs(up) * np.abs(inward[:, 1])
        rows.append(point)
    return np.stack(rows), columns.gap


@dataclass(frozen=True)
class _Columns:
    """(m,) each, from the subject's right to the left; mm. A gap is the mean of its neighbours."""

    start: np.ndarray  # where their crowns begin along the arch
    width: np.ndarray  # of their crowns
    at_edge: np.ndarray  # 0..1 of them
    at_neck: np.ndarray
    gap: np.ndarray  # 1 in the gaps
    height: np.ndarray
    rise: np.ndarray
    corner: np.ndarray  # how much further the edge rises

    def across(self, share: float) -> np.ndarray:
        """Where the columns are, 0..1 of their crowns, at a share of the crowns' height."""
        neck = np.clip((share - _EDGE) / (_NECK - _EDGE), 0.0, 1.0)
        return self.at_edge + neck * (self.at_neck - self.at_edge)


def _columns(row: Row) -> _Columns:
    left = np.stack([_crown(crown) for crown in row.crowns])
    right = left[::-1, ::-1] * [-1, -1, 1, 1, 1] + [1, 1, 0, 0, 0]
    crowns = np.concatenate([right, left])  # (crowns, COLUMNS + 1, 5)
    gaps = 0.5 * (crowns[1:, 0] + crowns[:-1, -1])[:, 2:]
    crowns[1:, 0, 2:] = gaps
    width = np.array([crown.width for crown in row.crowns])
    width = np.concatenate([width[::-1], width])
    start = np.cumsum(width) - width - 0.5 * width.sum()
    columns = np.concatenate([crowns[:, :-1].reshape(-1, 5), crowns[-1:, -1]])
    gap = np.arange(len(columns)) % COLUMNS == 0
    crown = np.minimum(np.arange(len(columns)) // COLUMNS, len(crowns) - 1)
    at_edge, at_neck, *rest = columns.T
    return _Columns(start[crown], width[crown], at_edge, at_neck, gap * 1.0, *rest)


def _crown(crown: Crown) -> np.ndarray:
    """(COLUMNS + 1, 5) of a crown on the subject's left and the gaps on both sides of it: where at
    the edge and the neck, its height, rise and corner.
    """
    near, far = crown.corners
    at_edge = [0.0, _END, *crown.level, 1 - _END, 1.0]
    corner = [_in_gap(near), near, 0.0, 0.0, far, _in_gap(far)]
    same = np.ones(COLUMNS + 1)
    return np.stack([at_edge, _AT_NECK, crown.height * same, crown.rise * same, corner], axis=-1)


def _in_gap(corner: float) -> float:
    """How far an edge has risen (mm) in the middle of the gap beside such a corner."""
    return 1.6 * corner + 0.3


def _arch(at: np.ndarray, inset: float) -> tuple[np.ndarray, np.ndarray]:
    """Points (m, 2) (x, z) of the arch at signed arc lengths (m,) from its middle, and inward unit
    normals (m, 2).
    """
    angle = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 4001)
    x, depth = np.sin(angle), np.cos(angle)
    x, depth = np.sign(x) * np.abs(x) ** (2 / _ARCH_POWER), np.abs(depth) ** (2 / _ARCH_POWER)
    curve = np.stack([_ARCH_HALF_WIDTH * x, FRONT_Z - _ARCH_DEPTH * (1 - depth)], axis=-1)
    tangent = np.gradient(curve, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=-1)
    curve = curve + inset * normal
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1))])
    length -= 0.5 * length[-1]
    points = np.stack([np.interp(at, length, curve[:, k]) for k in range(2)], axis=-1)
    inward = np.stack([np.interp(at, length, normal[:, k]) for k in range(2)], axis=-1)
    return points, inward
