"""Small meshes, lights at given places, and what a camera sees of a mesh by brute force."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from facestage.contract.light_stage import ON, LightStage
from facestage.render.light_terms import LitPoints
from reference.rendering.cook_torrance import normalize
from reference.rendering.intersect import first_hits


@dataclass(frozen=True)
class Mesh:
    """Vertices (n, 3) float32-exact and triangles (t, 3)."""

    vertices: np.ndarray
    triangles: np.ndarray

    def joined(self, other: Mesh) -> Mesh:
        return Mesh(
            np.concatenate([self.vertices, other.vertices]),
            np.concatenate([self.triangles, other.triangles + len(self.vertices)]),
        )


def plane(height: float = -0.1, half: float = 0.3) -> Mesh:
    """A square facing +Z."""
    corners = np.array(
        [[-half, -half, height], [half, -half, height], [half, half, height], [-half, half, height]]
    )
    return Mesh(np.float32(corners).astype(float), np.array([[0, 1, 2], [0, 2, 3]]))


def box(centre: tuple[float, float, float], half: float) -> Mesh:
    """An axis-aligned cube."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    faces = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    )
    triangles = np.concatenate([faces[:, [0, 1, 2]], faces[:, [0, 2, 3]]])
    return Mesh(np.float32(np.array(centre) + half * signs).astype(float), triangles)


def sphere(radius: float = 0.07, rows: int = 12, columns: int = 18) -> Mesh:
    """A triangulated sphere around the origin."""
    theta = np.linspace(0.02, np.pi - 0.02, rows)[:, None]
    phi = 2 * np.pi * np.arange(columns)[None] / columns
    points = np.stack(
        np.broadcast_arrays(
            np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)
        ),
        axis=-1,
    )
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns)).ravel()
    b = (np.arange(rows - 1)[:, None] * columns + (np.arange(columns) + 1) % columns).ravel()
    triangles = np.concatenate(
        [np.stack([a, a + columns, b], 1), np.stack([b, a + columns, b + columns], 1)]
    )
    return Mesh(np.float32(radius * points.reshape(-1, 3)).astype(float), triangles)


def random_triangles(count: int, seed: int) -> Mesh:
    """Triangles of a few centimetres in a ball of 10 cm."""
    random = np.random.default_rng(seed)
    centre = random.uniform(-0.1, 0.1, (count, 1, 3))
    vertices = np.float32(centre + random.normal(scale=0.03, size=(count, 3, 3))).astype(float)
    return Mesh(vertices.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def stage_at(position: ArrayLike, side: float, radiance: float = 1.0) -> LightStage:
    """Square lights at ``position`` (N, 3) that face the origin."""
    position = np.asarray(position, float)
    direction = -normalize(position)
    axis = normalize(np.cross(direction, [0.3, 1.0, 0.2]))
    count = len(position)
    return LightStage(
        position,
        direction,
        axis,
        np.full(count, side),
        np.full((count, 3), radiance),
        np.full(count, ON),
    )


@dataclass(frozen=True)
class Points:
    """Places on a mesh to be lit, seen from a pinhole at ``eye``."""

    points: np.ndarray
    normals: np.ndarray  # unit shading normals on the viewer's side
    facing: np.ndarray  # unit geometric normals on the viewer's side
    views: np.ndarray  # unit, towards the eye
    triangle: np.ndarray

    def lit(self, stage: LightStage, roughness: float) -> LitPoints:
        """What the tracer is given."""
        return lit_points((self.points, self.normals, self.facing, self.views), stage, roughness)


def lit_points(
    rows: tuple[np.ndarray, ...],
    stage: LightStage,
    roughness: float,
    keys: np.ndarray | None = None,
    numbers: np.ndarray | None = None,
) -> LitPoints:
    """``rows``: points, normals, facing, views; points and lights are named 0, 1, 2, ..."""
    if keys is None:
        keys = np.arange(len(rows[0]))
    if numbers is None:
        numbers = np.arange(len(stage))
    points, normals, facing, views = rows
    return LitPoints(points, normals, facing, views, stage, roughness, keys, numbers)


def seen_points(
    mesh: Mesh, side: int, eye: tuple[float, float, float] = (0.05, -0.08, 0.6), width: float = 0.45
) -> Points:
    """What a ``side`` x ``side`` image sees of the mesh, by brute force; shading normals lean 0.2
    rad off.
    """
    centre = (np.arange(side) + 0.5) / side - 0.5
    x, y = np.meshgrid(width * centre, -width * centre)
    target = np.stack([x.ravel(), y.ravel(), np.zeros(side * side)], axis=1)
    rays = normalize(target - np.array(eye))
    triangle, _, distance = first_hits(np.array(eye), rays, mesh.vertices, mesh.triangles)
    hit = triangle >= 0
    rays, triangle = rays[hit], triangle[hit]
    points = np.array(eye) + distance[hit, None] * rays
    a, b, c = (mesh.vertices[mesh.triangles[triangle, corner]] for corner in range(3))
    facing = normalize(np.cross(b - a, c - a))
    facing *= -np.sign((facing * rays).sum(1, keepdims=True))
    lean = 0.2 * np.random.default_rng(5).uniform(-1, 1, facing.shape)
    return Points(
        np.float32(points).astype(float),
        np.float32(normalize(facing + lean)).astype(float),
        np.float32(facing).astype(float),
        np.float32(-rays).astype(float),
        triangle,
    )
