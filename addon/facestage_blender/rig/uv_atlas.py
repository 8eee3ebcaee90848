"""Several UV squares packed into one: materials with textures of their own, and UDIM tiles.

No bpy: plain arrays.
"""

from __future__ import annotations

import numpy as np

# The largest square keeps this side; the others share the strip above and beside it, as
# ICT-FaceKit's atlas has it.
MAIN_SIDE = 0.75
# area of the triangles over the area that they cover, on a grid that makes the latter too large
OVERLAP_MAX = 1.3
_GRID = 256


def atlas(
    tile: np.ndarray, area: np.ndarray, corner_uvs: np.ndarray, corner_polygon: np.ndarray
) -> np.ndarray:
    """(l, 2) UV corners moved so that every group of polygons has a square of its own in 0..1.

    tile (p,) int: group of each polygon; area (p,) its surface: the group with most of it gets the
    largest square. corner_uvs (l, 2) within the group's unit square; corner_polygon (l,) int.
    """
    groups = np.unique(tile)
    total = [float(area[tile == group].sum()) for group in groups]
    order = groups[np.argsort(total)[::-1]]
    if len(order) == 1:
        return corner_uvs
    corners = np.empty((len(order), 3))
    corners[0] = 0.0, 1.0 - MAIN_SIDE, MAIN_SIDE
    corners[1:] = _strip(len(order) - 1)
    place = corners[np.argsort(order)[np.searchsorted(groups, tile)]][corner_polygon]
    return place[:, :2] + place[:, 2:] * np.clip(corner_uvs, 0.0, 1.0)


def overlaps(triangle_uvs: np.ndarray) -> bool:
    """Whether triangles (t, 3, 2) lie on one another in the UV square, as on a mesh whose halves
    share a texture.
    """
    edge1, edge2 = triangle_uvs[:, 1] - triangle_uvs[:, 0], triangle_uvs[:, 2] - triangle_uvs[:, 0]
    area = 0.5 * np.abs(edge1[:, 0] * edge2[:, 1] - edge1[:, 1] * edge2[:, 0])
    total = float(area.sum())
    if total <= 0:
        return True
    # Points spread over the triangles by area, several to a covered cell.
    count = np.maximum(np.round(area / total * 8 * _GRID**2 * min(total, 1.0)), 1).astype(int)
    owner = np.repeat(np.arange(len(area)), count)
    rng = np.random.default_rng(0)
    a, b = rng.random((2, len(owner)))
    a, b = np.where(a + b > 1, 1 - a, a), np.where(a + b > 1, 1 - b, b)
    points = triangle_uvs[owner, 0] + a[:, None] * edge1[owner] + b[:, None] * edge2[owner]
    cells = np.unique(np.floor(points * _GRID).astype(np.int64) @ np.array([1 << 20, 1]))
    return total * _GRID**2 > OVERLAP_MAX * len(cells)


def _strip(count: int) -> np.ndarray:
    """(count, 3) corners u, v and sides of equal squares in the L-shaped strip that the largest
    square leaves.
    """
    side = 1.0 - MAIN_SIDE
    split = 1
    while 7 * split**2 < count:
        split += 1
    small = side / split
    squares = []
    for u, v in [(MAIN_SIDE, MAIN_SIDE - k * side) for k in range(4)] + [
        (k * side, 0.0) for k in range(3)
    ]:
        squares += [
            (u + i * small, v + j * small, small) for i in range(split) for j in range(split)
        ]
    return np.array(squares[:count])
