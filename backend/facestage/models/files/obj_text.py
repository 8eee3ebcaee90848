"""The meshes in .obj files (Wavefront) that others published."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np

# Many more than any head has, and a coordinate in any unit.
POINT_LIMIT, COORDINATE_LIMIT = 500_000, 1e6


@dataclass(frozen=True)
class Mesh:
    """n vertices, t texture points and p quads or triangles of an .obj."""

    vertices: np.ndarray  # (n, 3) float64, in the file's unit
    texture: np.ndarray  # (t, 2) float64
    polygons: np.ndarray  # (p, 4) int32, from 0; the fourth is -1 for a triangle
    polygon_texture: np.ndarray  # (p, 4) int32 into `texture`, likewise


def parse_vertices(text: bytes, name: str) -> np.ndarray:
    """(n, 3) float64 positions in their own unit.

    Raises ValueError, which names the file, for anything else.
    """
    return _numbers([line[2:] for line in text.split(b"\n") if line.startswith(b"v ")], 3, name)


def parse_mesh(text: bytes, name: str) -> Mesh:
    """The whole mesh.

    Raises ValueError, which names the file, for a polygon of points that are not there.
    """
    lines = text.split(b"\n")
    vertices = parse_vertices(text, name)
    texture = _numbers([line[3:] for line in lines if line.startswith(b"vt ")], 2, name)
    corners = [
        [corner.split(b"/") for corner in line.split()[1:]]
        for line in lines
        if line.startswith(b"f ")
    ]
    if not all(3 <= len(polygon) <= 4 for polygon in corners):
        raise ValueError(f"{name} has a polygon that is no quad and no triangle")
    if any(len(corner) < 2 for polygon in corners for corner in polygon):
        raise ValueError(f"{name} has a polygon without texture points")
    return Mesh(
        vertices,
        texture,
        _indices([[corner[0] for corner in polygon] for polygon in corners], len(vertices), name),
        _indices([[corner[1] for corner in polygon] for polygon in corners], len(texture), name),
    )


def _numbers(lines: list[bytes], columns: int, name: str) -> np.ndarray:
    if not 0 < len(lines) <= POINT_LIMIT:
        raise ValueError(f"{name} has {len(lines)} points, expected 1 to {POINT_LIMIT}")
    try:
        numbers = np.loadtxt(io.BytesIO(b"\n".join(lines)), usecols=range(columns), ndmin=2)
    except ValueError as error:
        raise ValueError(f"{name} holds something else than numbers: {error}") from error
    if len(numbers) != len(lines) or not (np.abs(numbers) < COORDINATE_LIMIT).all():
        raise ValueError(f"{name} has a point without plausible numbers")
    return numbers


def _indices(polygons: list[list[bytes]], count: int, name: str) -> np.ndarray:
    """(p, 4) int32 from 0, of texts that count from 1."""
    try:
        rows = [[int(corner) - 1 for corner in polygon] for polygon in polygons]
    except ValueError as error:
        raise ValueError(f"{name} has a polygon of something else than numbers") from error
    if any(not 0 <= index < count for row in rows for index in row):
        raise ValueError(f"{name} has a polygon of points outside 1..{count}")
    return np.array([row + [-1] * (4 - len(row)) for row in rows], np.int32).reshape(-1, 4)
