"""What people wear on their faces, as simple meshes that fit the head: a cap, a fringe of hair, glasses.

All take a face model and its vertices (n, 3) for a person, metres in the model frame, and return a :class:`Worn`.
The 68 landmarks say where brows, eyes, nose and ears are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from facestage.contract.face_model import SKIN, FaceModel
from facestage_blender.synthetic import Worn

CAP_HEIGHT, CAP_THICKNESS = 0.014, 0.006  # m above the brows; off the skin
BRIM_LENGTH, BRIM_DROP, BRIM_ANGLE = 0.065, 0.018, 62.0  # m, m, degrees to either side
FRINGE_HEIGHT, FRINGE_JAG, FRINGE_THICKNESS = -0.006, 0.010, 0.007
FRINGE_SLOPE = 0.12  # how fast the hair recedes beside the parting
SKIN_GAP, TAPER = 0.0008, 0.012  # what lies on the skin does not touch it; m from the edge to the full lift
SUBDIVISIONS = 2
WIRE = 0.0018  # radius of the glasses' frame
RIM = (0.024, 0.018)  # half width and half height of a lens
CLEARANCE = 0.0015
BROWS = slice(17, 27)


def cap(model: FaceModel, vertices: np.ndarray, rng: np.random.Generator) -> Worn:
    """A cap whose brim shades the forehead and the eyes."""
    edge = _landmarks(model, vertices)[BROWS, 1].max() + CAP_HEIGHT
    crown, triangles = _shell(
        model, vertices, lambda at: np.full(len(at), edge), lambda at: np.full(len(at), CAP_THICKNESS)
    )
    ring = vertices[(np.abs(vertices[:, 1] - edge) < 0.012) & _skin(model)]
    front, half_width = ring[:, 2].max(), np.abs(ring[:, 0]).max()
    middle = ring[np.abs(ring[:, 0]).argmax(), 2]
    angle = np.radians(np.linspace(-BRIM_ANGLE, BRIM_ANGLE, 33))[:, None]
    # From inside the head, so that no light falls between the crown and the brim.
    out = np.linspace(-0.15, 1, 11)[None]
    bulge = np.cos(angle * 90.0 / BRIM_ANGLE) ** 0.7
    x = half_width * np.sin(angle) * (1 + 0.04 * out)
    z = middle + (front - middle) * np.cos(angle) + BRIM_LENGTH * bulge * out
    y = edge + 0.006 - BRIM_DROP * out * bulge - 0.25 * x**2 / half_width * (0.4 + 0.6 * out)
    brim, brim_triangles = _sheet(np.stack(np.broadcast_arrays(x, y, z), axis=-1))
    parts = [(crown, triangles), (brim, brim_triangles)]
    return _joined("Cap", parts, tuple(rng.uniform(0.02, 0.25, 3)), roughness=0.8)


def fringe(model: FaceModel, vertices: np.ndarray, rng: np.random.Generator) -> Worn:
    """Hair over the scalp whose ragged edge hangs over the forehead."""
    brow = _landmarks(model, vertices)[BROWS, 1].mean()
    places, strands = np.linspace(-0.12, 0.12, 33), np.linspace(-0.12, 0.12, 121)
    jag, thickness = rng.uniform(-1, 1, len(places)), FRINGE_THICKNESS * rng.uniform(0.5, 1.5, len(strands))
    parting = rng.uniform(-0.03, 0.03)

    def edge(at: np.ndarray) -> np.ndarray:
        ragged = FRINGE_JAG * np.interp(at[:, 0], places, jag)
        return brow + FRINGE_HEIGHT + ragged + FRINGE_SLOPE * np.abs(at[:, 0] - parting)

    points, triangles = _shell(model, vertices, edge, lambda at: np.interp(at[:, 0], strands, thickness))
    brown = np.array([0.045, 0.026, 0.016]) * rng.uniform(0.5, 2.0)
    return Worn("Fringe", points, triangles, tuple(brown), roughness=0.5)


def glasses(model: FaceModel, vertices: np.ndarray, _rng: np.random.Generator) -> Worn:
    """A wire frame with two rims, a bridge on the nose and temples to the ears, without lenses."""
    marks = _landmarks(model, vertices)
    skin = vertices[_skin(model)].astype(np.float64)
    eyes = np.stack([marks[36:42].mean(axis=0), marks[42:48].mean(axis=0)])
    around = np.linspace(0, 2 * np.pi, 49)[:-1]
    outward = np.array([-1.0, 1.0])[:, None]
    # A lens is wider than high, and its centre lies a little below and outside the eye's.
    x = eyes[:, :1] + 0.002 * outward + RIM[0] * np.sign(np.cos(around)) * np.abs(np.cos(around)) ** 0.8
    y = eyes[:, 1:2] - 0.003 + RIM[1] * np.sign(np.sin(around)) * np.abs(np.sin(around)) ** 0.8
    plane = max(_front(skin, rim).max() for rim in np.stack([x, y], axis=-1)) + WIRE + CLEARANCE
    parts = [_tube(np.stack([x[k], y[k], np.full(48, plane)], axis=-1), closed=True) for k in range(2)]
    level = eyes[:, 1].mean()
    parts.append(_tube(_bridge(skin, x[0].max(), x[1].min(), level + 0.004, plane)))
    for side, ear, hinge in ((-1.0, marks[0], x[0].min()), (1.0, marks[16], x[1].max())):
        parts.append(_tube(_temple(skin, side, np.array([abs(hinge), level + 0.006, plane]), ear)))
    return _joined("Glasses", parts, (0.03, 0.03, 0.035), roughness=0.35)


def _bridge(skin: np.ndarray, left: float, right: float, level: float, plane: float) -> np.ndarray:
    """(17, 3) path between the rims, arched over the nose."""
    x = np.linspace(left, right, 17)
    surface = _front(skin, np.stack([x, np.full(17, level)], axis=-1)) + WIRE + CLEARANCE
    arch = plane + max(surface.max() - plane, 0.0) * np.sin(np.pi * np.linspace(0, 1, 17)) ** 0.5
    return np.stack([x, np.full(17, level), np.maximum(surface, arch)], axis=-1)


def _temple(skin: np.ndarray, side: float, hinge: np.ndarray, ear: np.ndarray) -> np.ndarray:
    """(24, 3) path from a rim's hinge (its distance from the middle, y, z) back over the ear."""
    z = np.linspace(hinge[2], ear[2] - 0.025, 24)
    y = np.interp(z, [z[-1], z[0]], [max(ear[1] + 0.006, hinge[1]), hinge[1]])
    wide = np.array([_half_width(skin, side, *at) for at in zip(y, z, strict=True)]) + WIRE + CLEARANCE
    # Straight to where the head is widest, and nowhere inside it.
    reach = np.maximum.accumulate(np.maximum(np.linspace(hinge[0], wide.max(), 24), wide))
    return np.stack([side * reach, y, z], axis=-1)


KINDS: Mapping[str, Callable[[FaceModel, np.ndarray, np.random.Generator], Worn]] = {
    "cap": cap, "fringe": fringe, "glasses": glasses,
}  # fmt: skip


def _landmarks(model: FaceModel, vertices: np.ndarray) -> np.ndarray:
    """(68, 3) landmarks of the ibug68 scheme."""
    corners, weights = model.landmark_vertices("ibug68")
    return np.einsum("mi,mix->mx", weights, vertices[corners])


def _skin(model: FaceModel) -> np.ndarray:
    """(n,) bool: vertices of skin triangles."""
    skin = np.zeros(len(model.vertices), bool)
    skin[model.triangles[model.triangle_part == SKIN]] = True
    return skin


def _shell(
    model: FaceModel,
    vertices: np.ndarray,
    edge: Callable[[np.ndarray], np.ndarray],
    thickness: Callable[[np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """The skin above a height, lifted off the head; points and triangles.

    ``edge`` and ``thickness`` give the height and the lift (m,) at points (m, 3); the lift starts from 0 at the edge.
    """
    skin = model.triangles[model.triangle_part == SKIN]
    corners = vertices[skin].astype(np.float64)
    normal = np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(normal, skin[:, corner], np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    points, triangles = np.concatenate([vertices, normal], axis=1), skin
    # The meshes of heads are coarse where hair grows.
    for _ in range(SUBDIVISIONS):
        near = (points[:, 1] > edge(points[:, :3]) - 0.01)[triangles].any(axis=1)
        points, triangles = _subdivided(points, triangles[near])
    position, normal = points[:, :3], points[:, 3:]
    above = position[:, 1] - edge(position)
    lift = SKIN_GAP + thickness(position) * np.clip(above / TAPER, 0, 1) ** 0.5
    normal = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    used, triangles = np.unique(triangles[(above > 0)[triangles].all(axis=1)], return_inverse=True)
    return (position + lift[:, None] * normal)[used], triangles.reshape(-1, 3)


def _subdivided(points: np.ndarray, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each triangle as four, with the midpoints of its edges; points (n, c) of any number of coordinates."""
    edges = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
    ends, middle = np.unique(edges.reshape(-1, 2), axis=0, return_inverse=True)
    ab, bc, ca = (len(points) + middle.reshape(-1, 3)).T
    a, b, c = triangles.T
    finer = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]).transpose(2, 0, 1)
    return np.concatenate([points, points[ends].mean(axis=1)]), finer.reshape(-1, 3)


def _front(points: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(m,) z of the frontmost of the points (n, 3) within 5 mm of each place (m, 2)."""
    distance = np.linalg.norm(points[None, :, :2] - at[:, None], axis=-1)
    near = np.where(distance < np.maximum(0.005, distance.min(axis=1, keepdims=True)) + 1e-9, points[:, 2], -np.inf)
    return near.max(axis=1)


def _half_width(points: np.ndarray, side: float, level: float, depth: float) -> float:
    """How far points (n, 3) reach to a side around a height and a depth; 0 where there are none."""
    near = (np.abs(points[:, 1] - level) < 0.007) & (np.abs(points[:, 2] - depth) < 0.008)
    return max(0.0, float((side * points[near, 0]).max())) if near.any() else 0.0


def _sheet(grid: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a grid of points (r, c, 3)."""
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]
    triangles = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2)
    return grid.reshape(-1, 3), triangles.reshape(-1, 3)


def _tube(path: np.ndarray, closed: bool = False, sides: int = 8) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a wire of radius WIRE along a path (m, 3)."""
    if closed:
        path = np.concatenate([path, path[:1]])
    along = np.gradient(path, axis=0)
    if closed:
        along[0] = along[-1] = path[1] - path[-2]
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    # No part of a pair of glasses runs along this direction.
    first = np.cross(along, np.array([0.31, 0.37, 0.26]))
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    second = np.cross(along, first)
    turn = np.linspace(0, 2 * np.pi, sides + 1)[:, None]
    return _sheet(path[:, None] + WIRE * (np.cos(turn) * first[:, None] + np.sin(turn) * second[:, None]))


def _joined(
    name: str, parts: list[tuple[np.ndarray, np.ndarray]], color: tuple[float, float, float], roughness: float
) -> Worn:
    """One mesh of several."""
    starts = np.cumsum([0, *(len(points) for points, _ in parts[:-1])])
    return Worn(
        name, np.concatenate([points for points, _ in parts]),
        np.concatenate([triangles + start for (_, triangles), start in zip(parts, starts, strict=True)]), color,
        roughness,
    )  # fmt: skip
