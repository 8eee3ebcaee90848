"""A mesh of grids whose vertices know where they have their roots on a rig."""

from __future__ import annotations

import bpy
import numpy as np

from .vector_nodes import BALL, ROOT, WEIGHTS
from .wet_nodes import NUMBERS, TEAR


class WetGrids:
    """Vertices on grids, each with where it has its root on the rig."""

    def __init__(self) -> None:
        self.points: list[np.ndarray] = []
        self.quads: list[np.ndarray] = []
        self.roots: list[np.ndarray] = []
        self.weights: list[np.ndarray] = []
        self.balls: list[np.ndarray] = []
        self.numbers: list[np.ndarray] = []
        self.count = 0

    def add(
        self,
        points: np.ndarray,
        roots: np.ndarray,
        weights: np.ndarray | list[np.ndarray],
        ball: tuple[int, int],
        grid: tuple[int, int],
        *,
        wraps: bool,
        flips: bool = False,
    ) -> None:
        """A grid (rows, columns) of points; ``wraps``: its last column is beside its first;
        ``flips``: it faces the other way.
        """
        rows, columns = grid
        row, column = np.mgrid[: rows - 1, : columns if wraps else columns - 1]
        after = (column + 1) % columns
        quads = [
            row * columns + column,
            (row + 1) * columns + column,
            (row + 1) * columns + after,
            row * columns + after,
        ]
        if flips:
            quads.reverse()
        self.quads.append(np.stack(quads, axis=-1).reshape(-1, 4) + self.count)
        self.points.append(points)
        self.roots.append(roots)
        self.weights.append(np.asarray(weights))
        self.balls.append(np.tile(ball, (len(points), 1)))
        self.count += len(points)

    def attributes(self, *numbers: np.ndarray) -> None:
        """NUMBERS of each vertex of the last grid."""
        self.numbers.append(np.stack(numbers, axis=1))

    def write(self, mesh: bpy.types.Mesh) -> None:
        """Fill the mesh."""
        points, quads = np.concatenate(self.points), np.concatenate(self.quads)
        numbers = np.concatenate(self.numbers).astype(np.float32)
        mesh.from_pydata(points.tolist(), [], quads.tolist())
        mesh.update()
        mesh.shade_smooth()
        tear = numbers[quads[:, 0], NUMBERS.index(TEAR)]
        mesh.polygons.foreach_set("material_index", tear.astype(np.int32))
        integers = np.concatenate([np.concatenate(self.roots), np.concatenate(self.balls)], axis=1)
        for name, values in zip((*ROOT, *BALL), integers.T, strict=True):
            _attribute(mesh, name, "INT", "value", values.astype(np.int32))
        weights = np.concatenate(self.weights).astype(np.float32)
        _attribute(mesh, WEIGHTS, "FLOAT_VECTOR", "vector", weights.ravel())
        for name, values in zip(NUMBERS, numbers.T, strict=True):
            _attribute(mesh, name, "FLOAT", "value", np.ascontiguousarray(values))


def _attribute(mesh: bpy.types.Mesh, name: str, kind: str, field: str, values: np.ndarray) -> None:
    mesh.attributes.new(name, kind, "POINT").data.foreach_set(field, values)
