"""What people wear on their faces, as simple meshes that fit the head: a cap, a fringe of hair,
glasses.

Strands of hair and a hand are made by hair.py and hand.py. All take a face model and its vertices
(n, 3) for a person, metres in the model frame, and return a :class:`Worn`. The 68 landmarks say
where brows, eyes, nose and ears are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from facestage.contract.face_model import FaceModel

from ..truth import Worn, landmark_points
from .hair import strands
from .hand import hand
from .mesh import WIRE, front, half_width, joined_parts, sheet, shell, skin_vertices, tube

CAP_HEIGHT, CAP_THICKNESS = 0.014, 0.006  # m above the brows; off the skin
BRIM_LENGTH, BRIM_DROP, BRIM_ANGLE = 0.065, 0.018, 62.0  # m, m, degrees to either side
FRINGE_HEIGHT, FRINGE_JAG, FRINGE_THICKNESS = -0.006, 0.010, 0.007
FRINGE_SLOPE = 0.12  # how fast the hair recedes beside the parting
RIM = (0.024, 0.018)  # half width and half height of a lens
CLEARANCE = 0.0015
BROWS = slice(17, 27)


def cap(model: FaceModel, vertices: np.ndarray, rng: np.random.Generator) -> Worn:
    """A cap whose brim shades the forehead and the eyes."""
    edge = landmark_points(model, vertices)[BROWS, 1].max() + CAP_HEIGHT
    crown, triangles = shell(
        model,
        vertices,
        lambda at: np.full(len(at), edge),
        lambda at: np.full(len(at), CAP_THICKNESS),
    )
    ring = vertices[(np.abs(vertices[:, 1] - edge) < 0.012) & skin_vertices(model)]
    front, half_width = ring[:, 2].max(), np.abs(ring[:, 0]).max()
    middle = ring[np.abs(ring[:, 0]).argmax(), 2]
    angle = np.radians(np.linspace(-BRIM_ANGLE, BRIM_ANGLE, 33))[:, None]
    # From inside the head, so that no light falls between the crown and the brim.
    out = np.linspace(-0.15, 1, 11)[None]
    bulge = np.cos(angle * 90.0 / BRIM_ANGLE) ** 0.7
    x = half_width * np.sin(angle) * (1 + 0.04 * out)
    z = middle + (front - middle) * np.cos(angle) + BRIM_LENGTH * bulge * out
    y = edge + 0.006 - BRIM_DROP * out * bulge - 0.25 * x**2 / half_width * (0.4 + 0.6 * out)
    brim, brim_triangles = sheet(np.stack(np.broadcast_arrays(x, y, z), axis=-1))
    parts = [(crown, triangles), (brim, brim_triangles)]
    return Worn("Cap", *joined_parts(parts), tuple(rng.uniform(0.02, 0.25, 3)), roughness=0.8)


def fringe(model: FaceModel, vertices: np.ndarray, rng: np.random.Generator) -> Worn:
    """Hair over the scalp whose ragged edge hangs over the forehead."""
    brow = landmark_points(model, vertices)[BROWS, 1].mean()
    places, strands = np.linspace(-0.12, 0.12, 33), np.linspace(-0.12, 0.12, 121)
    jag, thickness = (
        rng.uniform(-1, 1, len(places)),
        FRINGE_THICKNESS * rng.uniform(0.5, 1.5, len(strands)),
    )
    parting = rng.uniform(-0.03, 0.03)

    def edge(at: np.ndarray) -> np.ndarray:
        ragged = FRINGE_JAG * np.interp(at[:, 0], places, jag)
        return brow + FRINGE_HEIGHT + ragged + FRINGE_SLOPE * np.abs(at[:, 0] - parting)

    points, triangles = shell(
        model, vertices, edge, lambda at: np.interp(at[:, 0], strands, thickness)
    )
    brown = np.array([0.045, 0.026, 0.016]) * rng.uniform(0.5, 2.0)
    return Worn("Fringe", points, triangles, tuple(brown), roughness=0.5)


def glasses(model: FaceModel, vertices: np.ndarray, _rng: np.random.Generator) -> Worn:
    """A wire frame with two rims, a bridge on the nose and temples to the ears, without lenses."""
    marks = landmark_points(model, vertices)
    skin = vertices[skin_vertices(model)].astype(np.float64)
    eyes = np.stack([marks[36:42].mean(axis=0), marks[42:48].mean(axis=0)])
    around = np.linspace(0, 2 * np.pi, 49)[:-1]
    outward = np.array([-1.0, 1.0])[:, None]
    # A lens is wider than high, and its centre lies a little below and outside the eye's.
    x = (
        eyes[:, :1]
        + 0.002 * outward
        + RIM[0] * np.sign(np.cos(around)) * np.abs(np.cos(around)) ** 0.8
    )
    y = eyes[:, 1:2] - 0.003 + RIM[1] * np.sign(np.sin(around)) * np.abs(np.sin(around)) ** 0.8
    plane = max(front(skin, rim).max() for rim in np.stack([x, y], axis=-1)) + WIRE + CLEARANCE
    parts = [
        tube(np.stack([x[k], y[k], np.full(48, plane)], axis=-1), closed=True) for k in range(2)
    ]
    level = eyes[:, 1].mean()
    parts.append(tube(_bridge(skin, x[0].max(), x[1].min(), level + 0.004, plane)))
    for side, ear, hinge in ((-1.0, marks[0], x[0].min()), (1.0, marks[16], x[1].max())):
        parts.append(tube(_temple(skin, side, np.array([abs(hinge), level + 0.006, plane]), ear)))
    return Worn("Glasses", *joined_parts(parts), (0.03, 0.03, 0.035), roughness=0.35)


def _bridge(skin: np.ndarray, left: float, right: float, level: float, plane: float) -> np.ndarray:
    """(17, 3) path between the rims, arched over the nose."""
    x = np.linspace(left, right, 17)
    surface = front(skin, np.stack([x, np.full(17, level)], axis=-1)) + WIRE + CLEARANCE
    arch = plane + max(surface.max() - plane, 0.0) * np.sin(np.pi * np.linspace(0, 1, 17)) ** 0.5
    return np.stack([x, np.full(17, level), np.maximum(surface, arch)], axis=-1)


def _temple(skin: np.ndarray, side: float, hinge: np.ndarray, ear: np.ndarray) -> np.ndarray:
    """(24, 3) path from a rim's hinge (its distance from the middle, y, z) back over the ear."""
    z = np.linspace(hinge[2], ear[2] - 0.025, 24)
    y = np.interp(z, [z[-1], z[0]], [max(ear[1] + 0.006, hinge[1]), hinge[1]])
    wide = (
        np.array([half_width(skin, side, *at) for at in zip(y, z, strict=True)]) + WIRE + CLEARANCE
    )
    # Straight to where the head is widest, and nowhere inside it.
    reach = np.maximum.accumulate(np.maximum(np.linspace(hinge[0], wide.max(), 24), wide))
    return np.stack([side * reach, y, z], axis=-1)


KINDS: Mapping[str, Callable[[FaceModel, np.ndarray, np.random.Generator], Worn]] = {
    "cap": cap,
    "fringe": fringe,
    "glasses": glasses,
    "strands": strands,
    "hand": hand,
}
