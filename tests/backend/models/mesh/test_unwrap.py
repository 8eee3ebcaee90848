"""Charts made for meshes without UVs: nothing overlaps, up is up, and odd meshes do not stop it."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.models.mesh.unwrap import SKIN_TILE, flipped, unwrap, unwrap_disc
from reference.published.heads import ball, head


def grid(
    rows: int, columns: int, holes: tuple[tuple[int, int], ...] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """A bumpy mask facing +Z; cells in ``holes`` are open."""
    v, u = np.mgrid[: rows + 1, : columns + 1]
    x, y = u.ravel() / columns - 0.5, v.ravel() / rows - 0.5
    points = np.stack([x, y, 0.4 * np.exp(-(x**2 + y**2) / 0.01) - x**2], axis=1)
    row, column = np.mgrid[:rows, :columns]
    keep = np.ones((rows, columns), bool)
    for hole in holes:
        keep[hole] = False
    a = (row * (columns + 1) + column)[keep]
    quads = np.stack([a, a + 1, a + columns + 2, a + columns + 1], axis=1)
    return points, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def area(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    u, v = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


@pytest.mark.parametrize("holes", [(), ((3, 4), (8, 9), (9, 9))])
def test_a_mask_with_holes_lies_flat(holes: tuple[tuple[int, int], ...]):
    vertices, triangles = grid(14, 16, holes)
    points, faces = unwrap_disc(vertices, triangles)
    assert not flipped(points, faces).any()
    # All face up inside a disc of this radius: the area is at most the disc's unless they overlap.
    assert area(points, faces).sum() <= np.pi * 0.49**2
    # Up is up and right is right.
    up, right = (
        np.polyfit(vertices[:, 1], points[:, 1], 1)[0],
        np.polyfit(vertices[:, 0], points[:, 0], 1)[0],
    )
    assert up > 0.3 and right > 0.3


@pytest.mark.parametrize("ring", [0, 60])
def test_a_head_is_cut_open_at_the_back(ring: int):
    face = head(1500, ring)
    points, faces = unwrap_disc(face.vertices, face.triangles)
    assert not flipped(points, faces).any()
    # Some vertices of the seam have a point on each side of it, all behind the face.
    twice = np.flatnonzero(np.bincount(face.triangles.ravel()) > 0)
    assert len(points) > len(twice)
    owner = np.zeros(len(points), int)
    owner[faces] = face.triangles
    seam = np.flatnonzero(np.bincount(owner) > 1)
    assert face.vertices[seam, 2].max() < 0.02


def test_eyeballs_have_tiles_of_their_own():
    face = head(1500, 60)
    left, rows = ball(100, 0.012, np.array([0.03, 0.03, 0.0]))
    right, _ = ball(100, 0.012, np.array([-0.03, 0.03, 0.0]))
    vertices = np.concatenate([face.vertices, left, right])
    triangles = np.concatenate([face.triangles, rows + 1500, rows + 1600])
    uvs, faces = unwrap(vertices, triangles)
    assert uvs.min() >= 0 and uvs.max() <= 1 and uvs.dtype == np.float32
    skin, first, second = (
        uvs[np.unique(faces[k])]
        for k in np.split(np.arange(len(faces)), [len(rows) * -2, len(rows) * -1])
    )
    assert skin[:, 1].min() >= SKIN_TILE[1] > max(first[:, 1].max(), second[:, 1].max())
    assert first[:, 0].max() <= second[:, 0].min() or second[:, 0].max() <= first[:, 0].min()


def test_meshes_that_are_no_disc_get_a_chart_all_the_same():
    # A torus has a handle; two triangles of one vertex are a bow tie; a doubled triangle has no
    # inside.
    turn = 2 * np.pi * np.arange(12) / 12
    u, v = (angle.ravel() for angle in np.meshgrid(turn, turn, indexing="ij"))
    torus = np.stack([(2 + np.cos(v)) * np.cos(u), (2 + np.cos(v)) * np.sin(u), np.sin(v)], axis=1)
    row, column = (index.ravel() for index in np.mgrid[:12, :12])
    a, b = row * 12 + column, row * 12 + (column + 1) % 12
    c, d = (row + 1) % 12 * 12 + (column + 1) % 12, (row + 1) % 12 * 12 + column
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    bow = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [-1, 0, 0], [-1, -1, 0.0]])
    for vertices, triangles in (
        (torus, faces),
        (bow, np.array([[0, 1, 2], [0, 3, 4]])),
        (bow, np.array([[0, 1, 2], [0, 1, 2]])),
        (bow, np.array([[0, 1, 2]])),
        (np.zeros((3, 3)), np.array([[0, 1, 2]])),
    ):
        uvs, chart = unwrap(vertices, triangles)
        assert (
            chart.shape == triangles.shape
            and np.isfinite(uvs).all()
            and uvs.min() >= 0
            and uvs.max() <= 1
        )


def test_slivers_and_doubled_points_do_no_harm():
    vertices, triangles = grid(10, 10)
    vertices[37] = vertices[38]
    points, faces = unwrap_disc(vertices, triangles)
    assert np.isfinite(points).all() and not flipped(points, faces).any()
