"""A surface laid on points of another: a known motion is found again, and where the two differ
plain closest points, run for as long as people score by, come no nearer.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.models.mesh.closest_alignment import closest_alignment
from facestage.models.mesh.similarity import Similarity, procrustes
from facestage.models.mesh.surface import Surface, closest_weights
from reference.synthetic_face import synthetic_face

IDENTITY = Similarity(1.0, np.eye(3), np.zeros(3))


def face() -> Surface:
    model = synthetic_face(17, 17)
    return Surface(model.vertices, model.triangles)


def points_on(surface: Surface, count: int = 500) -> np.ndarray:
    random = np.random.default_rng(3)
    triangle = random.integers(len(surface.triangles), size=count)
    weights = random.dirichlet(np.ones(3), count)
    return np.einsum("pk,pkx->px", weights, surface.vertices[surface.triangles[triangle]])


def moved(scale: float) -> Similarity:
    rotation = Rotation.from_rotvec([0.06, -0.1, 0.05]).as_matrix()
    return Similarity(scale, rotation, np.array([0.004, -0.003, 0.006]))


@pytest.mark.parametrize(("scale", "rigid"), [(1.07, False), (0.94, False), (1.0, True)])
def test_a_known_motion_is_found_again(scale: float, rigid: bool):
    surface, true = face(), moved(scale)
    found = closest_alignment(surface, true.apply(points_on(surface)), IDENTITY, rigid)
    assert found.scale == pytest.approx(scale, abs=1e-6)
    np.testing.assert_allclose(found.rotation, true.rotation, atol=1e-6)
    np.testing.assert_allclose(found.translation, true.translation, atol=1e-7)


def test_a_twentieth_of_strays_does_not_draw():
    surface, true = face(), moved(1.03)
    points = true.apply(points_on(surface))
    points[::25] += [0, 0, 0.05]
    found = closest_alignment(surface, points, IDENTITY)
    np.testing.assert_allclose(found.rotation, true.rotation, atol=1e-6)
    assert found.scale == pytest.approx(1.03, abs=1e-6)


def test_a_rigid_motion_keeps_its_scale():
    surface = face()
    found = closest_alignment(surface, moved(1.1).apply(points_on(surface)), IDENTITY, rigid=True)
    assert found.scale == 1.0
    np.testing.assert_allclose(found.rotation @ found.rotation.T, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("rigid", [False, True])
def test_where_the_surfaces_differ_no_plain_closest_points_come_nearer(rigid: bool):
    model = synthetic_face(9, 9)
    surface = Surface(model.vertices, model.triangles)
    on_it = points_on(surface, 200)
    points = moved(1.04).apply(on_it + 0.002 * np.sin(120 * on_it[:, [1, 2, 0]]))
    slow = IDENTITY
    for _ in range(60):
        foot, distance = _every_triangle(surface, points, slow)
        kept = distance <= np.quantile(distance, 0.95)
        slow = procrustes(foot[kept], points[kept], rigid)
    found = closest_alignment(surface, points, IDENTITY, rigid)
    ours, plain = (_every_triangle(surface, points, at)[1] for at in (found, slow))
    assert _trimmed(ours) < 1.03 * _trimmed(plain)
    assert 0.0002 < _trimmed(ours) < 0.003


def _trimmed(distance: np.ndarray) -> float:
    kept = distance <= np.quantile(distance, 0.95)
    return float(np.sqrt((distance[kept] ** 2).mean()))


def _every_triangle(
    surface: Surface, points: np.ndarray, at: Similarity
) -> tuple[np.ndarray, np.ndarray]:
    """Nearest points in the surface's frame and distances in the points', by looking at all."""
    corners = surface.vertices[surface.triangles]
    query = at.inverse().apply(points)
    weights = closest_weights(query[:, None], corners[None])
    feet = np.einsum("ptk,tkx->ptx", weights, corners)
    nearest = np.linalg.norm(feet - query[:, None], axis=2).argmin(axis=1)
    foot = feet[np.arange(len(points)), nearest]
    return foot, np.linalg.norm(at.apply(foot) - points, axis=1)
