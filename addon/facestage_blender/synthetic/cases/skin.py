"""What real skin has and no smooth albedo basis can explain: mottling, freckles, a beard. No bpy.

Each is a factor on a diffuse albedo texture of the UV square.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.face_model import SKIN, FaceModel

from ...pictures.texture import paint_vertices
from ..truth import landmark_points

MOTTLE_CELLS = (24, 96, 384)  # knots across the texture
FRECKLES = 450
FRECKLE_RADIUS = (0.0006, 0.0018)  # metres, one standard deviation of the dab
FRECKLE_DEPTH = (0.3, 0.8)  # natural logarithm of the darkening in green
# Melanin takes more from blue than from red; log darkening relative to green.
PIGMENT = np.array([0.65, 1.0, 1.25])
# log darkening of a full beard, and its relative variation from hair to hair
BEARD_DEPTH, STUBBLE = 1.3, 0.45


def noise(rng: np.random.Generator, size: int, cells: int) -> np.ndarray:
    """(size, size) noise of unit variance, linear between random values at ``cells`` x ``cells``
    knots.
    """
    knots = rng.normal(size=(cells + 1, cells + 1))
    at = (np.arange(size) + 0.5) / size * cells
    low = np.minimum(at.astype(int), cells - 1)
    share = at - low
    rows = knots[low] * (1 - share[:, None]) + knots[low + 1] * share[:, None]
    smooth = rows[:, low] * (1 - share) + rows[:, low + 1] * share
    return smooth / smooth.std()


def mottled(albedo: np.ndarray, deviation: float, rng: np.random.Generator) -> np.ndarray:
    """The texture (s, s, 3) with blotches and grain of relative standard deviation
    ``deviation``.
    """
    pattern = sum(noise(rng, len(albedo), cells) for cells in MOTTLE_CELLS) / np.sqrt(
        len(MOTTLE_CELLS)
    )
    return albedo * (1 + deviation * pattern[..., None])


def freckled(albedo: np.ndarray, model: FaceModel, rng: np.random.Generator) -> np.ndarray:
    """The texture (s, s, 3) with small dark spots, evenly spread over the face."""
    size = len(albedo)
    inside = np.zeros(len(model.vertices), bool)
    inside[model.regions.get("face", np.arange(len(model.vertices)))] = True
    rows = inside[model.triangles].all(axis=1) & (model.triangle_part == SKIN)
    corners, uvs = (
        model.vertices[model.triangles[rows]],
        model.uvs[model.triangle_uvs[rows]].astype(np.float64),
    )
    edges = corners[:, 1:] - corners[:, :1]
    area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    uv_edges = uvs[:, 1:] - uvs[:, :1]
    uv_area = 0.5 * np.abs(
        uv_edges[:, 0, 0] * uv_edges[:, 1, 1] - uv_edges[:, 0, 1] * uv_edges[:, 1, 0]
    )
    chosen = rng.choice(len(area), FRECKLES, p=area / area.sum())
    weights = rng.dirichlet(np.ones(3), FRECKLES)
    centre = np.einsum("fi,fix->fx", weights, uvs[chosen]) * size
    texels_per_metre = size * np.sqrt(uv_area[chosen] / np.maximum(area[chosen], 1e-12))
    radius = np.clip(rng.uniform(*FRECKLE_RADIUS, FRECKLES) * texels_per_metre, 0.5, 20.0)
    depth = rng.uniform(*FRECKLE_DEPTH, FRECKLES)
    darkening = np.zeros((size, size))
    for (x, y), spread, deep in zip(centre, radius, depth, strict=True):
        reach = int(np.ceil(3 * spread))
        column, row = int(x), int(size - y)
        lines = np.arange(max(0, row - reach), min(size, row + reach + 1))
        columns = np.arange(max(0, column - reach), min(size, column + reach + 1))
        square = (columns + 0.5 - x)[None] ** 2 + (lines + 0.5 - (size - y))[:, None] ** 2
        darkening[np.ix_(lines, columns)] += deep * np.exp(-square / (2 * spread**2))
    return albedo * np.exp(-darkening[..., None] * PIGMENT)


def bearded(albedo: np.ndarray, model: FaceModel, rng: np.random.Generator) -> np.ndarray:
    """The texture (s, s, 3) darkened where a beard grows, lips and neck left out."""
    weight = paint_vertices(
        beard_weight(model)[:, None], model.triangles, model.uvs, model.triangle_uvs, len(albedo)
    )[..., 0]
    hairs = np.clip(1 + STUBBLE * noise(rng, len(albedo), len(albedo) // 3), 0, 2)
    return albedo * np.exp(-BEARD_DEPTH * (weight * hairs)[..., None] * np.array([0.9, 1.0, 1.05]))


def beard_weight(model: FaceModel) -> np.ndarray:
    """(n,) 0..1: how much beard grows at each vertex of the mean face, from its 68 landmarks."""
    mark = landmark_points(model, model.vertices)
    x, y, z = model.vertices.T.astype(np.float64)
    half_width = 0.5 * abs(mark[14, 0] - mark[2, 0])
    # Up to the nose, down to the corners of the mouth on the cheeks, up again to the ears.
    knots = np.array([0.0, 0.35, 0.6, 1.0]) * half_width
    heights = np.array(
        [mark[33, 1] - 0.006, mark[33, 1] - 0.008, mark[48:55, 1].mean(), mark[[1, 15], 1].mean()]
    )
    upper = np.interp(np.abs(x - mark[33, 0]), knots, heights)
    lower = mark[8, 1] - 0.012
    back = mark[[1, 15], 2].mean() - 0.008
    outer = mark[48:60]
    lips, reach = outer.mean(axis=0), 0.5 * np.ptp(outer, axis=0)
    from_lips = ((x - lips[0]) / reach[0]) ** 2 + ((y - lips[1]) / reach[1]) ** 2
    weight = _step((upper - y) / 0.008) * _step((y - lower) / 0.012) * _step((z - back) / 0.012)
    weight *= _step((from_lips - 1.1) / 0.5)
    skin = np.zeros(len(model.vertices), bool)
    skin[model.triangles[model.triangle_part == SKIN]] = True
    return np.where(skin, weight, 0.0)


def _step(at: np.ndarray) -> np.ndarray:
    """0 below 0, 1 above 1, smooth between."""
    at = np.clip(at, 0, 1)
    return at * at * (3 - 2 * at)
