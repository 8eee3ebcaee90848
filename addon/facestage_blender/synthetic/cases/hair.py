"""Strands of hair that fall from the hairline over the forehead: narrow ribbons with skin between
them.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.face_model import FaceModel

from ..truth import Worn, landmark_points
from .mesh import front, joined_parts, sheet, shell, skin_vertices

HAIRLINE = 0.048  # m above the brows
SCALP_THICKNESS, SCALP_JAG = 0.008, 0.006
LOCKS, STRANDS = (9, 13), 16  # locks, drawn; strands in each
LOCK_WIDTH, STRAND_WIDTH = 0.006, 0.0011  # m, standard deviation of the roots; width of a ribbon
ROOT_SPREAD, SWEEP = 0.048, 0.016  # m to either side; m that a lock is swept aside on its way down
SIDE = 0.062  # m from the middle, beyond which the forehead turns away
END = (-0.022, 0.022)  # m above the brows where locks end
GAP, BULGE = 0.0016, 0.006  # m off the skin, at the ends and at most
STEPS = 15


def strands(model: FaceModel, vertices: np.ndarray, rng: np.random.Generator) -> Worn:
    """Hair over the scalp, and locks of thin strands that hang over the forehead to the brows and
    beyond.
    """
    brow = float(landmark_points(model, vertices)[17:27, 1].mean())
    hairline = brow + HAIRLINE
    places = np.linspace(-0.12, 0.12, 33)
    jag = SCALP_JAG * rng.uniform(-1, 1, len(places))

    def edge(at: np.ndarray) -> np.ndarray:
        # Beside the forehead hair grows down to the ears.
        return hairline + np.interp(at[:, 0], places, jag) - 6.0 * at[:, 0] ** 2

    parts = [shell(model, vertices, edge, lambda at: np.full(len(at), SCALP_THICKNESS))]
    skin = vertices[skin_vertices(model)].astype(np.float64)
    skin = skin[(skin[:, 1] > brow + 2 * END[0]) & (skin[:, 2] > 0)]
    for root in ROOT_SPREAD * rng.uniform(-1, 1, rng.integers(*LOCKS)):
        sweep, end = SWEEP * rng.normal(), brow + rng.uniform(*END)
        curl, phase = 0.004 * rng.uniform(), rng.uniform(0, 2 * np.pi)
        for _ in range(STRANDS):
            offset = LOCK_WIDTH * rng.normal() * np.array([1.0, 0.4])
            t = np.linspace(0, 1, STEPS)
            # A lock's strands meet at its tip.
            x = root + offset[0] * (1 - 0.7 * t) + sweep * t**1.5 + curl * np.sin(phase + 5 * t)
            y = hairline + 0.006 + t * (end + offset[1] - hairline - 0.006)
            path = np.stack([np.clip(x, -SIDE, SIDE), y], axis=-1)
            z = front(skin, path) + GAP + BULGE * rng.uniform(0.2, 1) * np.sin(np.pi * t) ** 0.7
            parts.append(_ribbon(np.column_stack([path, z]), STRAND_WIDTH * rng.uniform(0.5, 1.5)))
    brown = np.array([0.05, 0.03, 0.018]) * rng.uniform(0.5, 2.0)
    return Worn("Strands", *joined_parts(parts), tuple(brown), roughness=0.45)


def _ribbon(path: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Points and triangles of a band along a path (m, 3), which faces the front and narrows towards
    its end.
    """
    along = np.gradient(path[:, :2], axis=0)
    across = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(
        along, axis=1, keepdims=True
    )
    half = 0.5 * width * np.linspace(1, 0.1, len(path))[:, None] ** 0.6 * across
    side = np.column_stack([half, np.zeros(len(path))])
    return sheet(np.stack([path - side, path + side], axis=1))
