"""Where the face of a mesh is, roughly: a similarity from the default face, whatever unit and axes
the mesh has.
"""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.models.mesh.similarity import Similarity
from facestage.models.mesh.surface import Surface

# A face that is further away than this, in the default face's metres, is not this face.
CUTOFF = 0.015
# Height of the whole default head over that of what a mesh may show: a mask, a head, a bust.
_HEIGHT_RATIOS = (2.0, 1.6, 1.28, 1.0, 0.8, 0.64, 0.5)
_FEW, _MANY = 100, 300


def coarse_alignments(
    points: np.ndarray,
    normals: np.ndarray,
    nose: np.ndarray,
    height: float,
    surface: Surface,
    focus: np.ndarray,
) -> list[tuple[float, Similarity]]:
    """The best similarities from the default face to a mesh, with their costs, best first.

    points, normals (m, 3): the default face, metres; nose (3,) its tip; height: of the whole
    default head.
    surface: the mesh; focus (n,) bool: its vertices that may be face. Every way of pointing up and
    forward is tried at several sizes, nose on the foremost point; the cost is the mean distance in
    metres of the default face, cut off at ``CUTOFF``. Ties go to the axes of Blender and of most
    files, which are tried first.
    """
    rng = np.random.default_rng(0)
    few = rng.choice(len(points), min(_FEW, len(points)), replace=False)
    many = rng.choice(len(points), min(_MANY, len(points)), replace=False)
    candidates = surface.vertices[np.intersect1d(np.flatnonzero(focus), surface.triangles)]
    if not len(candidates):
        return []
    size = float(np.ptp(candidates, axis=0).max())
    starts = []
    for rotation in axis_rotations():
        turned = candidates @ rotation  # the mesh in the default face's axes
        tip = candidates[turned[:, 2].argmax()]
        extent = float(np.ptp(turned[:, 1]))
        for ratio in _HEIGHT_RATIOS:
            scale = ratio * max(extent, 1e-6 * size) / height
            starts.append(Similarity(scale, rotation, tip - scale * rotation @ nose))
    ranked = _improved(starts, points[few], normals[few], surface, steps=4)
    ranked = _improved(
        [start for _, start in ranked[:12]], points[many], normals[many], surface, steps=12
    )
    return ranked[:2]


def _improved(
    starts: list[Similarity], points: np.ndarray, normals: np.ndarray, surface: Surface, steps: int
) -> list[tuple[float, Similarity]]:
    """Each start after some steps of rigid ICP with scale, sorted by cost."""
    results = []
    for start in starts:
        current = start
        for _ in range(steps):
            current = _icp_step(current, points, normals, surface)
        results.append((_cost(current, points, normals, surface), current))
    return sorted(results, key=lambda item: item[0])


def _matches(
    similarity: Similarity, points: np.ndarray, normals: np.ndarray, surface: Surface
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Moved points, nearest samples, their normals towards the face's side, and distances in source
    units.
    """
    moved = similarity.apply(points)
    distance, sample = surface.tree.query(moved)
    normal = surface.normal[surface.sample_triangle[sample]]
    cosine = np.einsum("mc,mc->m", normal, normals @ similarity.rotation.T)
    # Which side is out is not known yet.
    distance = np.where(np.abs(cosine) > 0.4, distance / similarity.scale, np.inf)
    return moved, surface.sample[sample], normal * np.sign(cosine)[:, None], distance


def _cost(
    similarity: Similarity, points: np.ndarray, normals: np.ndarray, surface: Surface
) -> float:
    return float(np.minimum(_matches(similarity, points, normals, surface)[3], CUTOFF).mean())


def _icp_step(
    similarity: Similarity, points: np.ndarray, normals: np.ndarray, surface: Surface
) -> Similarity:
    """One linearised point-to-plane step over rotation, translation and scale, robust in the
    distance.
    """
    moved, foot, normal, distance = _matches(similarity, points, normals, surface)
    near = distance < 3 * CUTOFF
    if near.sum() < 12:
        return similarity
    moved, foot, normal, distance = moved[near], foot[near], normal[near], distance[near]
    weight = 1.0 / (1.0 + (distance / (0.5 * CUTOFF)) ** 2)
    unit = similarity.scale * 0.05
    middle = moved.mean(axis=0)
    arm = (moved - middle) / unit
    columns = np.concatenate(
        [np.cross(arm, normal), normal, np.einsum("mc,mc->m", arm, normal)[:, None]], axis=1
    )
    residual = np.einsum("mc,mc->m", normal, foot - moved) / unit
    system = (columns * weight[:, None]).T @ columns + 1e-3 * weight.sum() * np.eye(7)
    step = np.linalg.solve(system, (columns * weight[:, None]).T @ residual)
    turn = Rotation.from_rotvec(np.clip(step[:3], -0.3, 0.3)).as_matrix()
    grow = float(np.exp(np.clip(step[6], -0.15, 0.15)))
    shift = step[3:6] * unit
    translation = grow * turn @ (similarity.translation - middle) + middle + shift
    return Similarity(similarity.scale * grow, turn @ similarity.rotation, translation)


def axis_rotation(up: int, front: int) -> np.ndarray:
    """(3, 3) rotation from the model frame (+Y up, +Z front) to axes with these: 0..5 for +X, +Y,
    +Z, -X, -Y, -Z.
    """
    axes = np.concatenate([np.eye(3), -np.eye(3)])
    y, z = axes[up], axes[front]
    return np.stack([np.cross(y, z), y, z], axis=1)


def axis_rotations() -> list[np.ndarray]:
    """All 24 ways of pointing up and forward, the usual ones first: +Y up and +Z forward, Blender's
    +Z and -Y.
    """
    usual = [(1, 2), (2, 4), (2, 1), (1, 5), (2, 0), (2, 3)]
    rest = [
        (u, f) for u, f in product(range(6), repeat=2) if u % 3 != f % 3 and (u, f) not in usual
    ]
    return [axis_rotation(up, front) for up, front in usual + rest]
