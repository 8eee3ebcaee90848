"""Skin that is not smooth: grooves, bumps and a fine relief of known height. No bpy.

Heights are drawn over the mean face in space, so that no seam of the texture is one of the skin,
and painted into its UV square. How deep and how wide: creases of 0.2 to 0.6 mm depth and 1 to 3 mm
width (Akazaki et al. 2002, replicas of eye corners), bumps as of moles and papules; the fine relief
has slopes of 5 degrees.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.face_model import SKIN, FaceModel

from ...pictures.texture import paint_vertices
from .mesh import subdivided

GROOVES, BUMPS, WAVES = 60, 90, 120
# metres: length of a groove, its width and that of a bump (one standard deviation of the profile)
GROOVE_LENGTH, GROOVE_WIDTH, BUMP_WIDTH = (0.008, 0.03), (0.0005, 0.0011), (0.0007, 0.0018)
GROOVE_DEPTH, BUMP_HEIGHT = (0.15, 0.5), (-0.15, 0.4)  # mm
WAVE_LENGTH, WAVE_SLOPE = (0.002, 0.006), 0.09  # metres; root mean square
BORDER_ROUNDS = 6  # of neighbours over which the relief fades towards the face's border
LEVELS = 3  # of subdivision of the mesh that is photographed


def height_map(model: FaceModel, size: int, rng: np.random.Generator) -> np.ndarray:
    """(size, size) height in mm over the UV square, row 0 at v = 1; 0 where there is no face."""
    columns = np.concatenate([model.vertices, _inside(model)[:, None]], axis=1)
    painted = paint_vertices(columns, model.triangles, model.uvs, model.triangle_uvs, size)
    place, share = painted[..., :3].reshape(-1, 3).astype(np.float64), painted[..., 3].ravel()
    result = np.zeros(len(place))
    near = np.flatnonzero(share > 0)
    result[near] = share[near] * _height(model, place[near], rng)
    return result.reshape(size, size)


def _height(model: FaceModel, at: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(m,) mm at places (m, 3) of the mean face, metres."""
    face = model.vertices[_inside(model) > 0.5].astype(np.float64)
    result, order = np.zeros(len(at)), np.argsort(at[:, 0])
    sorted_x = at[order, 0]
    for centre in face[rng.choice(len(face), GROOVES)]:
        along, across = _tangents(face, centre, rng)
        half = 0.5 * rng.uniform(*GROOVE_LENGTH)
        width, depth = rng.uniform(*GROOVE_WIDTH), rng.uniform(*GROOVE_DEPTH)
        near = _near(at, order, sorted_x, centre, 3 * half)
        offset = at[near] - centre
        s = offset @ along
        bend = rng.uniform(-0.25, 0.25) * s**2 / half
        profile = np.exp(-0.5 * ((offset @ across - bend) / width) ** 2 - (s / half) ** 4)
        result[near] -= depth * profile
    for centre in face[rng.choice(len(face), BUMPS)]:
        height, width = rng.uniform(*BUMP_HEIGHT), rng.uniform(*BUMP_WIDTH)
        near = _near(at, order, sorted_x, centre, 5 * width)
        distance = ((at[near] - centre) ** 2).sum(axis=1)
        result[near] += height * np.exp(-0.5 * distance / width**2)
    waves = 2 * np.pi / rng.uniform(*WAVE_LENGTH, WAVES)
    directions = rng.normal(size=(WAVES, 3))
    directions *= (waves / np.linalg.norm(directions, axis=1))[:, None]
    phases = rng.uniform(0, 2 * np.pi, WAVES)
    # Each wave as steep as any other; of the slope across the skin two of three directions count.
    steep = 1e3 * WAVE_SLOPE * np.sqrt(3.0 / WAVES) / waves
    for direction, phase, height in zip(directions, phases, steep, strict=True):
        result += height * np.sin(at @ direction + phase)
    return result


def _near(
    at: np.ndarray, order: np.ndarray, sorted_x: np.ndarray, centre: np.ndarray, reach: float
) -> np.ndarray:
    """Indices of the places within ``reach`` of a point; ``order`` sorts them by x."""
    first, last = np.searchsorted(sorted_x, (centre[0] - reach, centre[0] + reach))
    found = order[first:last]
    return found[((at[found] - centre) ** 2).sum(axis=1) < reach**2]


def _tangents(
    points: np.ndarray, centre: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Two unit directions along the surface of points (n, 3) at one of them."""
    near = points[((points - centre) ** 2).sum(axis=1) < 0.01**2] - centre
    first, second, _ = np.linalg.svd(near, full_matrices=False)[2]
    angle = rng.uniform(0, np.pi)
    return (
        np.cos(angle) * first + np.sin(angle) * second,
        np.cos(angle) * second - np.sin(angle) * first,
    )


def _inside(model: FaceModel) -> np.ndarray:
    """(n,) 1 within the narrow face's skin, fading to 0 at its border."""
    inside = np.zeros(len(model.vertices))
    inside[model.regions.get("narrow_face", np.arange(len(inside)))] = 1.0
    skin = model.triangles[model.triangle_part == SKIN]
    outer = inside[skin].min(axis=1) < 1
    inside[np.setdiff1d(np.arange(len(inside)), skin)] = 0.0
    inside[skin[outer]] = 0.0
    for _ in range(BORDER_ROUNDS):
        low = inside[skin].min(axis=1)
        lowest = inside.copy()
        np.minimum.at(lowest, skin, (low + 1.0 / BORDER_ROUNDS)[:, None])
        inside = lowest
    return inside


def displaced(
    model: FaceModel, vertices: np.ndarray, height: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The head with ``height`` (s, s) in mm on its skin, finely divided where there is any.

    Returns points (m, 3) in the frame of ``vertices``, unit normals (m, 3), texture coordinates
    (m, 2), triangles (t, 3) and their parts (t,). The normals are those of the smooth head, turned
    by the height's gradient: the facets of the mesh are not seen.
    """
    normal = np.zeros((len(vertices), 3))
    corners = vertices[model.triangles].astype(np.float64)
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for corner in range(3):
        np.add.at(normal, model.triangles[:, corner], faces)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-20)
    pairs = np.stack([model.triangles.ravel(), model.triangle_uvs.ravel()], axis=1)
    pairs, index = np.unique(pairs, axis=0, return_inverse=True)
    points = np.concatenate(
        [vertices[pairs[:, 0]], normal[pairs[:, 0]], model.uvs[pairs[:, 1]]], axis=1
    ).astype(np.float64)
    triangles, part = index.reshape(-1, 3), model.triangle_part
    fine = (_inside(model) > 0)[model.triangles].any(axis=1) & (part == SKIN)
    coarse, parts = triangles[~fine], [part[~fine]]
    triangles = triangles[fine]
    for _ in range(LEVELS):
        points, triangles = subdivided(points, triangles)
    parts.append(np.full(len(triangles), SKIN, part.dtype))
    metres = 1e-3 * _sampled(height, points[:, 6:])
    normals = points[:, 3:6] / np.linalg.norm(points[:, 3:6], axis=1, keepdims=True)
    slope = _gradient(points[:, :3], triangles, metres)
    slope -= normals * (slope * normals).sum(axis=1, keepdims=True)
    turned = normals - slope
    turned /= np.linalg.norm(turned, axis=1, keepdims=True)
    return (
        points[:, :3] + metres[:, None] * normals,
        turned,
        points[:, 6:],
        np.concatenate([coarse, triangles]),
        np.concatenate(parts),
    )


def _gradient(points: np.ndarray, triangles: np.ndarray, values: np.ndarray) -> np.ndarray:
    """(n, 3) of values (n,) on a surface: the mean over the triangles around a vertex."""
    a, b, c = (points[triangles[:, corner]] for corner in range(3))
    first, second = b - a, c - a
    normal = np.cross(first, second)
    by_first, by_second = np.cross(second, normal), np.cross(normal, first)
    of_first, of_second = (values[triangles[:, k]] - values[triangles[:, 0]] for k in (1, 2))
    square = np.maximum((normal**2).sum(axis=1), 1e-40)
    slope = (of_first[:, None] * by_first + of_second[:, None] * by_second) / square[:, None]
    area = np.sqrt(square)
    total, weight = np.zeros((len(points), 3)), np.zeros(len(points))
    for corner in range(3):
        weight += np.bincount(triangles[:, corner], area, len(points))
        for axis in range(3):
            total[:, axis] += np.bincount(triangles[:, corner], area * slope[:, axis], len(points))
    return total / np.maximum(weight, 1e-40)[:, None]


def _sampled(texture: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    """(m,) values of a texture (s, s), row 0 at v = 1, at ``uvs`` (m, 2): bilinear."""
    size = len(texture)
    x = np.clip(uvs[:, 0] * size - 0.5, 0, size - 1.001)
    y = np.clip((1 - uvs[:, 1]) * size - 0.5, 0, size - 1.001)
    column, row = x.astype(int), y.astype(int)
    right, down = x - column, y - row
    upper = texture[row, column] * (1 - right) + texture[row, column + 1] * right
    lower = texture[row + 1, column] * (1 - right) + texture[row + 1, column + 1] * right
    return np.asarray(upper * (1 - down) + lower * down)
