"""Vertex values painted into the UV square. No bpy: plain arrays."""

from __future__ import annotations

import numpy as np


def paint_vertices(
    values: np.ndarray, triangles: np.ndarray, uvs: np.ndarray, triangle_uvs: np.ndarray, size: int
) -> np.ndarray:
    """(size, size, c) float32 texture, row 0 at v = 1, of vertex values (n, c) interpolated over
    triangles (t, 3).

    Texels that no triangle covers take the value of their nearest covered neighbours, so that
    bilinear lookups at a seam do not bleed the background in.
    """
    corners = np.asarray(uvs, np.float64)[triangle_uvs] * size
    corners[..., 1] = size - corners[..., 1]
    values = np.asarray(values, np.float32)
    texture = np.zeros((size, size, values.shape[1]), np.float32)
    covered = np.zeros((size, size), bool)
    low = np.floor(corners.min(axis=1)).astype(int)
    extent = np.maximum(1, (np.ceil(corners.max(axis=1)).astype(int) - low).max(axis=1))
    # Triangles of similar extent share one grid of pixel centres: a handful of passes instead of t.
    steps = 2 ** np.ceil(np.log2(extent)).astype(int)
    for step in np.unique(steps):
        chosen = np.flatnonzero(steps == step)
        for part in np.array_split(chosen, max(1, len(chosen) * step * step // 2_000_000)):
            _paint(texture, covered, values[triangles[part]], corners[part], low[part], int(step))
    return _filled(texture, covered)


def _paint(
    texture: np.ndarray,
    covered: np.ndarray,
    values: np.ndarray,
    corners: np.ndarray,
    low: np.ndarray,
    step: int,
) -> None:
    """Paint triangles whose bounding boxes fit ``step`` x ``step`` pixels from ``low``."""
    size = len(texture)
    grid = np.stack(np.meshgrid(np.arange(step), np.arange(step)), axis=-1).reshape(-1, 2)
    pixel = low[:, None] + grid
    offset = pixel + 0.5 - corners[:, None, 0]
    edge1, edge2 = (
        corners[:, None, 1] - corners[:, None, 0],
        corners[:, None, 2] - corners[:, None, 0],
    )
    area = edge1[..., 0] * edge2[..., 1] - edge1[..., 1] * edge2[..., 0]
    area = np.where(np.abs(area) < 1e-12, np.inf, area)
    b = (offset[..., 0] * edge2[..., 1] - offset[..., 1] * edge2[..., 0]) / area
    c = (edge1[..., 0] * offset[..., 1] - edge1[..., 1] * offset[..., 0]) / area
    inside = (b >= -1e-9) & (c >= -1e-9) & (b + c <= 1 + 1e-9) & np.isfinite(area)
    inside &= ((pixel >= 0) & (pixel < size)).all(axis=-1)
    triangle, point = np.nonzero(inside)
    weights = np.stack([1 - b - c, b, c], axis=-1)[triangle, point]
    x, y = pixel[triangle, point].T
    texture[y, x] = np.einsum("pi,pic->pc", weights, values[triangle])
    covered[y, x] = True


def _filled(texture: np.ndarray, covered: np.ndarray) -> np.ndarray:
    """Grow the covered area by the mean of its neighbours until nothing is left, coarse levels for
    the far gaps.
    """
    if covered.all() or not covered.any():
        return texture
    for _ in range(8):
        weight, total = covered.astype(np.float32), np.where(covered[..., None], texture, 0)
        weight, total = _box(weight[..., None]), _box(total)
        fresh = ~covered & (weight[..., 0] > 0)
        texture = np.where(fresh[..., None], total / np.maximum(weight, 1e-6), texture)
        covered = covered | fresh
    if not covered.all():
        texture = np.where(covered[..., None], texture, texture[covered].mean(axis=0))
    return texture.astype(np.float32)


def _box(image: np.ndarray) -> np.ndarray:
    """Sum over the 3 x 3 neighbourhood of (h, w, c)."""
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)))
    rows = padded[:-2] + padded[1:-1] + padded[2:]
    return rows[:, :-2] + rows[:, 1:-1] + rows[:, 2:]
