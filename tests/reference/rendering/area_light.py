"""Direct light of square area lights: the sum over given sample points, and the integral over a
fine grid.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.light_stage import LightStage
from reference.rendering.cook_torrance import cook_torrance, dot, normalize
from reference.rendering.intersect import occluded

MIN_VIEW_COSINE = 1e-3  # the model ends at grazing view


def tea(key: np.ndarray, salt: np.ndarray, rounds: int = 4) -> np.ndarray:
    """Numbers in [0, 1) by the Tiny Encryption Algorithm (Zafar et al. 2010), 23 bits as a float32
    keeps.
    """
    mask = 0xFFFFFFFF
    first, second, total = key & mask, salt & mask, 0
    for _ in range(rounds):
        total = (total + 0x9E3779B9) & mask
        mixed = ((second << 4) + 0xA341316C) ^ (second + total) ^ ((second >> 5) + 0xC8013EA4)
        first = (first + (mixed & mask)) & mask
        mixed = ((first << 4) + 0xAD90777D) ^ (first + total) ^ ((first >> 5) + 0x7E95761E)
        second = (second + (mixed & mask)) & mask
    return (second >> 9).astype(float) / 2**23


def lattice(points: int, lights: int, samples: int, seed: int) -> np.ndarray:
    """(points, lights, samples, 2) positions in the unit square: Roberts' R2 sequence, shifted per
    point and light.
    """
    return keyed_lattice(np.arange(points), lights, samples, seed)


def keyed_lattice(keys: np.ndarray, lights: int, samples: int, seed: int) -> np.ndarray:
    """The same for points with ``keys`` (points,) of their own."""
    key = np.broadcast_to(keys.astype(np.uint64)[:, None, None], (len(keys), lights, 1))
    salt = np.arange(lights, dtype=np.uint64)[:, None] * 0x9E3779B1 + 2 * seed
    step = np.arange(samples) * np.array([[0.7548776662466927], [0.5698402909980532]])
    shift = [tea(key, salt + axis) for axis in (1, 2)]
    return np.stack([(step[axis] + shift[axis]) % 1.0 for axis in (0, 1)], axis=-1)


def grid(points: int, lights: int, side: int) -> np.ndarray:
    """(points, lights, side^2, 2) cell centres of the unit square."""
    centre = (np.arange(side) + 0.5) / side
    cells = np.stack(np.meshgrid(centre, centre), axis=-1).reshape(-1, 2)
    return np.broadcast_to(cells, (points, lights, side * side, 2))


def direct_light(
    points: np.ndarray,
    normals: np.ndarray,
    views: np.ndarray,
    stage: LightStage,
    roughness: float,
    square: np.ndarray,
    start: np.ndarray | None = None,
    mesh: tuple[np.ndarray, np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Diffuse and specular integrals (points, lights) at unit radiance over the sample positions
    ``square``.

    ``start`` (points, 3) is where shadow rays begin and ``mesh`` (vertices, triangles) what they
    may hit.
    """
    diffuse, specular = np.zeros(square.shape[:2]), np.zeros(square.shape[:2])
    grazing = np.maximum(dot(normals, views), MIN_VIEW_COSINE)
    for light in range(len(stage)):
        for k in range(square.shape[2]):
            on_light = (square[:, light, k] - 0.5) * stage.side[light]
            across = on_light[:, :1] * stage.axis_x[light] + on_light[:, 1:] * stage.axis_y[light]
            target = stage.position[light] + across
            offset = target - points
            direction = normalize(offset)
            cosine = -dot(direction, stage.direction[light])
            nl = dot(normals, direction)
            seen = (cosine > 0) & (nl > 0)
            if mesh is not None and start is not None and seen.any():
                seen[seen] = ~occluded(start[seen], target[seen], *mesh)
            weight = np.where(
                seen, stage.side[light] ** 2 / square.shape[2] * cosine / dot(offset, offset), 0.0
            )
            diffuse[:, light] += weight * np.maximum(nl, 0)
            # Tilt the view to the clamped cosine only where it is clamped: elsewhere this is the
            # plain formula.
            lobe = cook_torrance(normals, direction, views, roughness)
            specular[:, light] += weight * np.where(
                grazing > MIN_VIEW_COSINE, lobe * np.maximum(nl, 0), 0.0
            )
    return diffuse, specular
