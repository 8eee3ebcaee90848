"""A face-like model small enough for brute force: a bumpy half ellipsoid with UVs, modes and 68
landmarks.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.face_model import SKIN, FaceModel

IDENTITY = ("width", "height", "nose", "lean")
EXPRESSION = ("jaw_open", "smile", "brow_up")


def _bump(u: np.ndarray, v: np.ndarray, at: tuple[float, float], size: float) -> np.ndarray:
    return np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * size**2))


def synthetic_relief(model: FaceModel) -> np.ndarray:
    """(2, n, 3) float32: 0.4 mm outwards, waves along the face and across it."""
    outward = model.vertices / np.linalg.norm(model.vertices, axis=1, keepdims=True)
    waves = [np.sin(60 * model.vertices[:, axis] + 0.5) for axis in (0, 1)]
    return np.stack([4e-4 * wave[:, None] * outward for wave in waves]).astype(np.float32)


def synthetic_face(rows: int = 23, columns: int = 23, expression_prior: str = "box") -> FaceModel:
    """About 15 x 20 x 8 cm; ``rows`` x ``columns`` vertices, every polygon skin, one UV chart."""
    v, u = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, columns), indexing="ij")
    u, v = u.ravel(), v.ravel()
    longitude, latitude = 1.6 * u, 1.2 * v
    outward = np.stack(
        [
            np.sin(longitude) * np.cos(latitude),
            np.sin(latitude),
            np.cos(longitude) * np.cos(latitude),
        ],
        axis=1,
    )
    nose = _bump(u, v, (0, -0.1), 0.12)
    eyes = _bump(u, v, (-0.25, 0.25), 0.12) + _bump(u, v, (0.25, 0.25), 0.12)
    mouth = _bump(u, v, (0, -0.45), 0.14)
    vertices = (
        outward * [0.075, 0.105, 0.09] * (1 + 0.22 * nose - 0.06 * eyes + 0.04 * mouth)[:, None]
    )
    vertices = vertices - [0, 0, 0.06]
    polygons = _quads(rows, columns)
    identity = np.stack(
        [
            0.004 * np.stack([outward[:, 0], 0 * u, 0 * u], 1),
            0.005 * np.stack([0 * u, outward[:, 1], 0 * u], 1),
            0.006 * nose[:, None] * outward,
            0.003 * np.stack([np.sin(2 * v), 0 * u, np.cos(2 * u) * v], 1),
        ]
    )
    lower = 1 / (1 + np.exp((v + 0.4) / 0.08))
    corners = _bump(u, v, (-0.2, -0.45), 0.15) - _bump(u, v, (0.2, -0.45), 0.15)
    brows = _bump(u, v, (-0.25, 0.45), 0.15) + _bump(u, v, (0.25, 0.45), 0.15)
    expression = np.stack(
        [
            0.012 * lower[:, None] * [0, -1, -0.3],
            0.008 * np.stack([-corners, 0.7 * np.abs(corners), 0 * u], 1),
            0.008 * brows[:, None] * [0, 1, 0.2],
        ]
    )
    red = _bump(u, v, (-0.4, -0.1), 0.25) + _bump(u, v, (0.4, -0.1), 0.25) + mouth
    albedo = (
        np.array([0.46, 0.31, 0.24])
        * (1 - 0.25 * eyes[:, None])
        * (1 - red[:, None] * [0.0, 0.25, 0.2])
    )
    modes = [
        0.20 * np.ones((len(u), 3)),
        0.15 * u[:, None] * [1, 1, 1],
        0.15 * v[:, None] * [1, 1, 1],
        0.20 * red[:, None] * [0.2, -1, -0.8],
        0.12 * np.cos(3 * u + 2 * v)[:, None] * [0.5, 1, 1.2],
    ]
    return FaceModel(
        name="synthetic",
        license="CC0",
        source="made for tests",
        vertices=vertices.astype(np.float32),
        polygons=polygons,
        polygon_uvs=polygons.copy(),
        polygon_part=np.full(len(polygons), SKIN, np.uint8),
        uvs=np.stack([(u + 1) / 2, (v + 1) / 2], 1).astype(np.float32) * np.float32(0.96)
        + np.float32(0.02),
        identity_names=IDENTITY,
        identity_basis=identity.astype(np.float32),
        expression_names=EXPRESSION,
        expression_basis=expression.astype(np.float32),
        albedo_mean=albedo.astype(np.float32),
        albedo_basis=np.stack(modes).astype(np.float32),
        landmarks={"ibug68": _landmarks(u, v)},
        regions={"narrow_face": np.flatnonzero(np.abs(u) < 0.6).astype(np.int32)},
        expression_prior=expression_prior,
    )


def _quads(rows: int, columns: int) -> np.ndarray:
    """(p, 4) counter-clockwise seen from outside; the first is split into two triangles."""
    row, column = np.mgrid[: rows - 1, : columns - 1]
    a = (row * columns + column).ravel()
    quads = np.stack([a, a + 1, a + columns + 1, a + columns], axis=1)
    first = quads[0]
    split = np.array([[first[0], first[1], first[2], -1], [first[0], first[2], first[3], -1]])
    return np.concatenate([split, quads[1:]]).astype(np.int32)


def _landmarks(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(68, 6): 17 along a jaw line, the rest on three rings inside; nearest vertices, pairwise
    different.
    """
    angle = np.linspace(-np.pi * 0.95, -0.05 * np.pi, 17)
    wanted = [(0.6 * np.cos(a), 0.75 * np.sin(a)) for a in angle]
    for count, radius in ((25, 0.5), (17, 0.33), (9, 0.16)):
        wanted += [
            (radius * np.cos(a), radius * np.sin(a)) for a in 2 * np.pi * np.arange(count) / count
        ]
    taken: list[int] = []
    for x, y in wanted:
        distance = (u - x) ** 2 + (v - y) ** 2
        distance[taken] = np.inf
        taken.append(int(distance.argmin()))
    zeros = np.zeros(68)
    return np.stack([taken, taken, taken, zeros + 1, zeros, zeros], axis=1)
