"""A hollow sphere with a lamp in it."""

from __future__ import annotations

import numpy as np

from facestage.contract.light_stage import ON, LightStage
from facestage.fit.face.geometry import FaceGeometry
from reference.shadow_scene import card_and_wall

RADIUS, RADIANCE, SIDE = 0.1, 50.0, 0.01


def inside_of_a_sphere(rows: int = 40) -> FaceGeometry:
    """Latitudes and longitudes, the triangles turned inwards."""
    model = card_and_wall()
    polar, around = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, rows),
        np.linspace(0, 2 * np.pi, 2 * rows, endpoint=False),
        indexing="ij",
    )
    flat = np.sin(polar)
    vertices = RADIUS * np.stack([flat * np.cos(around), np.cos(polar), flat * np.sin(around)], -1)
    row, column = np.mgrid[: rows - 1, : 2 * rows]
    a, b = row * 2 * rows + column, row * 2 * rows + (column + 1) % (2 * rows)
    quads = np.stack([a, b, b + 2 * rows, a + 2 * rows], -1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 2, 1]], quads[:, [0, 3, 2]]])
    geometry = FaceGeometry(model)
    geometry.triangles, geometry.mean = triangles, vertices.reshape(-1, 3)
    geometry.triangle_part = np.zeros(len(triangles), geometry.triangle_part.dtype)
    geometry.fitted = np.ones(len(triangles), bool)
    if (geometry.vertex_normals(geometry.mean)[0] * geometry.mean).sum() > 0:
        geometry.triangles = triangles[:, ::-1]
    return geometry


def lamp_in_the_middle() -> LightStage:
    return LightStage(
        np.zeros((1, 3)),
        np.array([[0.0, 0.0, -1.0]]),
        np.array([[1.0, 0.0, 0.0]]),
        np.array([SIDE]),
        np.full((1, 3), RADIANCE),
        np.array([ON]),
    )
