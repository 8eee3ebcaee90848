"""Two rows of teeth with their gums: strips along the dental arches, one crown after the other.

Crown sizes after Nelson and Ash 2010, "Wheeler's Dental Anatomy"; the upper incisors end two
millimetres below the line where the lips meet, as they show when lips part at rest (Vig and Brundo
1978, "The kinetics of anterior tooth display").
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Row:
    """One dental arch, from the midline to the second molar; mm.

    inset: how far the row stands behind the upper one. edge: height of the incisal edge. rise: of
    each biting edge above (upper row) or below (lower row) the incisal one. lean: how far the
    front teeth's gums stand back, by mm from their edges.
    """

    widths: tuple[float, ...]
    heights: tuple[float, ...]
    rise: tuple[float, ...]
    inset: float
    edge: float
    away: float  # the direction of the gum: 1 up, -1 down
    lean: float = 0.0


UPPER = Row((8.6, 6.6, 7.6, 7.1, 6.8, 10.2, 9.2), (10.2, 9.0, 10.0, 8.8, 8.2, 7.6, 7.2),
            (0.0, 0.7, 0.1, 0.6, 0.8, 1.0, 1.2), 0.0, -75.1, 1.0)  # fmt: skip
LOWER = Row((5.3, 5.9, 6.8, 7.0, 7.1, 11.0, 10.4), (8.6, 9.0, 10.0, 8.8, 8.2, 7.6, 7.2),
            (0.0, 0.0, 0.1, 0.6, 0.9, 1.0, 0.8), 2.8, -73.3, -1.0, 0.3)  # fmt: skip
FRONT_Z = 92.4  # of the upper incisors: just behind the lips
_ARCH_HALF_WIDTH, _ARCH_DEPTH, _ARCH_POWER = 27.8, 46.4, 2.25

_ACROSS = (0.0, 0.06, 0.34, 0.66, 0.94)  # columns of a crown; the first is the gap before it
_GAP_DEPTH = 0.45
# Rows from the gum over the biting edge to the back: share of the crown's height, mm inward, part.
GUM_ROWS = 2
_PROFILE = (
    (1.45, 1.6),
    (1.03, 0.3),
    (0.97, 0.7),
    (0.6, 0.0),
    (0.2, 0.25),
    (0.0, 0.7),
    (0.0, 1.7),
    (0.8, 5.0),
)
PROFILE = len(_PROFILE)


def strip(row: Row) -> tuple[np.ndarray, np.ndarray]:
    """(PROFILE, m, 3) mm, from the subject's right to the left, and how deep in a gap each column
    (m,) lies, 0..1.
    """
    widths = np.array([*row.widths[::-1], *row.widths])
    bounds = np.concatenate([[0.0], np.cumsum(widths)]) - sum(row.widths)
    number = np.array([*range(len(row.widths))[::-1], *range(len(row.widths))])
    at = np.concatenate(
        [(bounds[:-1, None] + widths[:, None] * np.array(_ACROSS)).ravel(), bounds[-1:]]
    )
    tooth = np.concatenate([np.repeat(number, len(_ACROSS)), number[-1:]])
    across = np.concatenate([np.tile(_ACROSS, len(widths)), [0.0]])
    gap = (across == 0.0).astype(np.float64)
    middle = np.sin(np.pi * across)  # 1 in the middle of a crown, 0 in the gaps
    arch, inward = _arch(at, row.inset)
    # A gap takes the mean of its two neighbours.
    before = np.concatenate([number[:1], number])[np.cumsum(gap).astype(int) - 1]
    height = _of_tooth(row.heights, tooth, before, gap)
    edge = row.edge + row.away * _of_tooth(row.rise, tooth, before, gap)
    rows = []
    for share, depth in _PROFILE:
        scallop = -1.0 * (1 - middle) if share > 0.9 else 0.0  # gums reach down between the teeth
        rounding = 0.8 * gap + 0.2 * (1 - middle) if share < 0.1 else 0.0
        up = row.away * (share * height + scallop + rounding)
        bulge = 0.5 * (1 - middle) + _GAP_DEPTH * gap * (share < 1.0)
        point = np.stack([arch[:, 0], edge + up, arch[:, 1]], axis=-1)
        point[:, [0, 2]] += (depth + bulge)[:, None] * inward
        point[:, 2] -= row.lean * np.abs(up) * np.abs(inward[:, 1])
        rows.append(point)
    return np.stack(rows), gap


def _of_tooth(
    values: tuple[float, ...], tooth: np.ndarray, before: np.ndarray, gap: np.ndarray
) -> np.ndarray:
    table = np.array(values)
    return np.where(gap > 0, 0.5 * (table[tooth] + table[before]), table[tooth])


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
