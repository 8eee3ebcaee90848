"""The quad layout: a grid over the chart with rectangular windows, each filled by concentric
loops.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from facestage.models.head.base_surface import LEVELS

HALF_STATIONS = np.concatenate([np.arange(0, 7, 0.25), 7 + np.arange(10) / 3])
# first and last are the back midline
STATION_LINES = np.concatenate([-HALF_STATIONS[:0:-1], HALF_STATIONS])
# Twice as many levels over the nose, whose underside turns sharply.
_NOSE_LEVELS = 32 / 3 + np.arange(16) / 6
# ... and over the brows, whose hair ends sharply.
_BROW_LEVELS = 56 / 3 + np.arange(8) / 6
LEVEL_LINES = np.concatenate(
    [
        np.arange(0, 5, 0.5),
        5 + np.arange(17) / 3,
        _NOSE_LEVELS,
        40 / 3 + np.arange(16) / 3,
        _BROW_LEVELS,
        np.arange(20, LEVELS, 0.5),
    ]
)


@dataclass(frozen=True)
class Window:
    """A rectangle of grid cells left out: column and row index ranges, ends included as
    boundary.
    """

    left: int
    right: int
    bottom: int
    top: int

    @classmethod
    def around(cls, stations: tuple[float, float], levels: tuple[float, float]) -> Window:
        """The window whose borders are the grid lines nearest to the given chart lines."""
        column = [int(np.abs(STATION_LINES - s).argmin()) for s in stations]
        row = [int(np.abs(LEVEL_LINES - v).argmin()) for v in levels]
        return cls(column[0], column[1], row[0], row[1])

    @property
    def width(self) -> int:
        """Cells across."""
        return self.right - self.left

    @property
    def height(self) -> int:
        """Cells from bottom to top."""
        return self.top - self.bottom

    def loop(self) -> np.ndarray:
        """(n, 2) column and row of the border, counterclockwise from the middle of the left
        side.
        """
        middle = self.bottom + self.height // 2
        corners = [(self.left, middle), (self.left, self.bottom), (self.right, self.bottom)]
        corners += [(self.right, self.top), (self.left, self.top), (self.left, middle)]
        path: list[tuple[int, int]] = []
        for (c0, r0), (c1, r1) in pairwise(corners):
            steps = abs(c1 - c0) + abs(r1 - r0)
            path += [
                (c0 + (c1 - c0) * k // steps, r0 + (r1 - r0) * k // steps) for k in range(steps)
            ]
        return np.array(path)


WINDOWS = {
    "eye_right": Window.around((-4.75, -1.75), (15, 18 + 1 / 3)),
    "eye_left": Window.around((1.75, 4.75), (15, 18 + 1 / 3)),
    "mouth": Window.around((-3.25, 3.25), (6 + 2 / 3, 10 + 2 / 3)),
    "ear_right": Window.around((-8.0, -7.0), (6, 13 + 1 / 3)),
    "ear_left": Window.around((7.0, 8.0), (6, 13 + 1 / 3)),
}


@dataclass
class MeshBuilder:
    """Vertices in mm, UV points in chart units, and polygons, appended piece by piece."""

    positions: list[np.ndarray] = field(default_factory=list)
    polygons: list[np.ndarray] = field(default_factory=list)
    polygon_uvs: list[np.ndarray] = field(default_factory=list)
    parts: list[np.ndarray] = field(default_factory=list)
    uvs: list[np.ndarray] = field(default_factory=list)
    vertex_count: int = 0
    uv_count: int = 0

    def add_vertices(self, positions: np.ndarray) -> np.ndarray:
        """Append (m, 3) positions; returns their indices."""
        self.positions.append(np.asarray(positions, np.float64))
        self.vertex_count += len(positions)
        return np.arange(self.vertex_count - len(positions), self.vertex_count)

    def add_uvs(self, uvs: np.ndarray) -> np.ndarray:
        """Append (m, 2) UV points; returns their indices."""
        self.uvs.append(np.asarray(uvs, np.float64))
        self.uv_count += len(uvs)
        return np.arange(self.uv_count - len(uvs), self.uv_count)

    def add_polygons(self, polygons: np.ndarray, polygon_uvs: np.ndarray, part: int) -> None:
        """Append (p, 4) quads, -1 in the fourth place for triangles."""
        self.polygons.append(np.asarray(polygons))
        self.polygon_uvs.append(np.asarray(polygon_uvs))
        self.parts.append(np.full(len(polygons), part, np.uint8))

    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """vertices (n, 3), polygons (p, 4), polygon_uvs (p, 4), parts (p,), uvs (u, 2)."""
        return (
            np.concatenate(self.positions),
            np.concatenate(self.polygons).astype(np.int32),
            np.concatenate(self.polygon_uvs).astype(np.int32),
            np.concatenate(self.parts),
            np.concatenate(self.uvs),
        )


def ring_quads(loops: np.ndarray) -> np.ndarray:
    """(p, 4) quads between consecutive closed loops of indices (rings, n), outermost first,
    counterclockwise.

    Quads are split along their first diagonal; it leads away from the corners of the opening, at 0
    and n / 2, on both sides of them, so that the sharp turn of the loops there folds no triangle.
    """
    outer, inner = loops[:-1], loops[1:]
    n = loops.shape[1]
    quads = np.stack([outer, np.roll(outer, -1, 1), np.roll(inner, -1, 1), inner], axis=-1)
    towards_corner = np.arange(n) % (n // 2) >= n // 4
    quads[:, towards_corner] = np.roll(quads[:, towards_corner], -1, axis=-1)
    return quads.reshape(-1, 4)


def cap_quads(loop: np.ndarray) -> np.ndarray:
    """(p, 4) quads that close a loop of an even number of indices by a ladder between its two
    sides.
    """
    n = len(loop)
    forward, backward = loop[1 : n // 2], loop[: n // 2 : -1]
    sides = pairwise(zip(forward, backward, strict=True))
    rungs = [(a0, a1, b1, b0) for (a0, b0), (a1, b1) in sides]
    return np.array(
        [
            (loop[0], forward[0], backward[0], -1),
            *rungs,
            (forward[-1], loop[n // 2], backward[-1], -1),
        ]
    )


def grid_quads(
    builder: MeshBuilder, positions: np.ndarray, pole: np.ndarray, part: int
) -> np.ndarray:
    """Add the grid with its windows left open and its crown closed; returns vertex and UV indices
    (2, rows, columns).

    positions (rows, columns, 3) on all grid lines, the last column equal to the first; pole (3,)
    the crown. Vertices strictly inside a window get index -1.
    """
    rows, columns = positions.shape[:2]
    inside = np.zeros((rows, columns), bool)
    cell_open = np.zeros((rows - 1, columns - 1), bool)
    for window in WINDOWS.values():
        inside[window.bottom + 1 : window.top, window.left + 1 : window.right] = True
        cell_open[window.bottom : window.top, window.left : window.right] = True
    vertex = np.full((rows, columns), -1)
    kept = ~inside
    kept[:, -1] = False  # welded to the first column
    vertex[kept] = builder.add_vertices(positions[kept])
    vertex[:, -1] = vertex[:, 0]
    uv = np.full((rows, columns), -1)
    chart = np.stack(np.meshgrid(STATION_LINES, LEVEL_LINES), axis=-1)
    uv[~inside] = builder.add_uvs(chart[~inside])

    def corners(index: np.ndarray) -> np.ndarray:
        return np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1)[
            ~cell_open
        ]

    builder.add_polygons(corners(vertex), corners(uv), part)
    top = builder.add_vertices(pole[None])[0]
    middles = 0.5 * (STATION_LINES[:-1] + STATION_LINES[1:])
    top_uv = builder.add_uvs(np.stack([middles, np.full(columns - 1, float(LEVELS))], axis=-1))
    absent = np.full(columns - 1, -1)
    builder.add_polygons(
        np.stack([vertex[-1, :-1], vertex[-1, 1:], np.full(columns - 1, top), absent], axis=-1),
        np.stack([uv[-1, :-1], uv[-1, 1:], top_uv, absent], axis=-1),
        part,
    )
    return np.stack([vertex, uv])
