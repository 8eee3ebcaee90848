"""Shadows and first hits, ray by ray, against every triangle tried in turn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from facestage.contract.light_stage import LightStage
from facestage.render.light_terms import Asked
from reference.rendering.area_light import direct_light, lattice
from reference.rendering.cook_torrance import normalize
from reference.rendering.intersect import first_hits, intersections
from reference.rendering.meshes import (
    Mesh,
    Points,
    box,
    lit_points,
    plane,
    random_triangles,
    seen_points,
    sphere,
    stage_at,
)

SHADOW_OFFSET = 2e-4
LIGHTS = stage_at(np.array([[0.5, 0.1, 0.6], [-0.3, 0.6, 0.4], [0.1, -0.7, 0.25]]), side=1e-4)
SCENES = {
    "box over plane": box((0.02, 0.03, 0.0), 0.04).joined(plane()),
    "sphere over plane": sphere().joined(plane()),
    "random triangles": random_triangles(60, 1).joined(plane(-0.15)),
}


def clear_of_edges(seen: Points, mesh: Mesh, stage: LightStage) -> tuple[np.ndarray, np.ndarray]:
    """Brute force: shadowed (P, N), and where four neighbouring rays of 0.3 mm aside agree (P,
    N).
    """
    start = seen.points + SHADOW_OFFSET * seen.facing
    tangent = normalize(np.cross(seen.facing, [0.31, 0.52, 0.79]))
    other = np.cross(seen.facing, tangent)
    shadowed = np.zeros((len(start), len(stage)), bool)
    agree = np.ones_like(shadowed)
    for light in range(len(stage)):
        for step, (a, b) in enumerate([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]):
            moved = start + 3e-4 * (a * tangent + b * other)
            offset = stage.position[light] - moved
            length = np.linalg.norm(offset, axis=1)
            blocked = (
                intersections(moved, offset / length[:, None], mesh.vertices, mesh.triangles)[
                    0
                ].min(1)
                < length
            )
            if step == 0:
                shadowed[:, light] = blocked
            agree[:, light] &= blocked == shadowed[:, light]
    return shadowed, agree


@pytest.mark.parametrize("name", list(SCENES))
def test_hard_shadows_pixel_by_pixel(tracer_of, name: str, tmp_path: Path):
    mesh = SCENES[name]
    seen = seen_points(mesh, 36)
    shadowed, agree = clear_of_edges(seen, mesh, LIGHTS)
    tracer = tracer_of(mesh)
    points = seen.lit(LIGHTS, 0.4)
    lit = tracer.light_terms(points, 1, seed=0, asked=Asked(shadows=False)).diffuse > 0
    found = tracer.light_terms(points, 1, seed=0).diffuse > 0
    wanted = lit & ~shadowed
    counted = lit & agree
    wrong = counted & (found != wanted)
    print(
        f"{name}: {counted.sum()} rays, {(counted & shadowed).sum()} in shadow, {wrong.sum()} "
        f"wrong, {(lit & ~agree).sum()} at an edge left out"
    )
    if wrong.any():
        np.savez(
            tmp_path / "wrong.npz", points=seen.points, wrong=wrong, found=found, wanted=wanted
        )
    assert not wrong.any(), f"see {tmp_path / 'wrong.npz'}"
    assert (counted & shadowed).sum() > 100 and (counted & ~shadowed).sum() > 100


@pytest.mark.parametrize("name", list(SCENES))
def test_soft_shadows_sample_for_sample(tracer_of, name: str):
    mesh = SCENES[name]
    seen = seen_points(mesh, 16)
    stage = stage_at(LIGHTS.position, side=0.25)
    terms = tracer_of(mesh).light_terms(seen.lit(stage, 0.4), 6, seed=4)
    square = lattice(len(seen.points), len(stage), 6, 4)
    start = seen.points + SHADOW_OFFSET * seen.facing
    diffuse, specular = direct_light(
        seen.points,
        seen.normals,
        seen.views,
        stage,
        0.4,
        square,
        start,
        (mesh.vertices, mesh.triangles),
    )
    # One of six samples on the other side of an edge changes a pixel by a sixth: rare, and only at
    # edges.
    wrong = np.abs(terms.diffuse - diffuse) > 1e-3 * diffuse.max()
    print(f"{name}: {wrong.sum()} of {wrong.size} soft shadows differ by a sample")
    assert wrong.mean() < 0.005
    assert np.percentile(np.abs(terms.specular - specular), 99) < 1e-3 * specular.max()


def test_a_smooth_shaded_mesh_does_not_shadow_its_lit_side(tracer_of):
    mesh = sphere(rows=24, columns=36)
    seen = seen_points(mesh, 30, eye=(0, 0, 0.6), width=0.16)
    stage = stage_at([[0.0, 0.0, 1.0]], side=0.05)
    tracer = tracer_of(mesh)
    # Where the light sees the facet at 12 degrees or more, the offset clears the facet's own plane.
    upright = seen.facing[:, 2] > 0.2
    lit = seen.lit(stage, 0.4)
    open_sky = tracer.light_terms(lit, 4, seed=0, asked=Asked(shadows=False)).diffuse[upright]
    shadowed = tracer.light_terms(lit, 4, seed=0).diffuse[upright]
    np.testing.assert_allclose(shadowed, open_sky, rtol=1e-5)


@pytest.mark.parametrize("name", list(SCENES))
def test_first_hits_off_axis(tracer_of, name: str):
    mesh = SCENES[name]
    random = np.random.default_rng(8)
    origin = np.array([0.3, -0.2, 0.5])
    directions = normalize(random.uniform(-0.25, 0.25, (1500, 3)) - origin)
    triangle, _, distance = first_hits(origin, directions, mesh.vertices, mesh.triangles)
    hits = tracer_of(mesh).first_hits(origin, directions)
    same = hits.triangle == triangle
    print(
        f"{name}: {(~same).sum()} of {len(same)} rays differ (at shared edges), "
        f"{(triangle < 0).sum()} miss"
    )
    assert (~same).sum() <= 3
    hit = same & (triangle >= 0)
    assert hit.sum() > 300
    corners = mesh.vertices[mesh.triangles[triangle[hit]]]
    place = np.einsum("pi,pix->px", hits.barycentric[hit].astype(float), corners)
    wanted = origin + distance[hit, None] * directions[hit]
    assert np.linalg.norm(place - wanted, axis=1).max() < 1e-5
    np.testing.assert_allclose(hits.barycentric.sum(1), 1, atol=1e-6)


def test_first_hits_from_many_origins(tracer_of):
    mesh = SCENES["random triangles"]
    random = np.random.default_rng(9)
    origin = random.uniform(-0.4, 0.4, (800, 3))
    directions = normalize(random.normal(size=(800, 3)))
    triangle, _, _ = first_hits(origin, directions, mesh.vertices, mesh.triangles)
    assert (tracer_of(mesh).first_hits(origin, directions).triangle != triangle).sum() <= 2


def test_moving_the_mesh_moves_its_shadow(tracer_of):
    mesh = plane(0.0).joined(box((0.0, 0.0, 0.1), 0.03))
    tracer = tracer_of(mesh)
    up = np.array([[0.0, 0, 1]])
    stage = stage_at([[0, 0, 0.8]], side=0.01)

    def light() -> float:
        point = lit_points((np.zeros((1, 3)), up, up, up), stage, 0.4)
        return float(tracer.light_terms(point, 1, seed=0).diffuse[0, 0])

    assert light() == 0
    moved = mesh.vertices.copy()
    moved[4:, 0] += 0.1
    tracer.update(moved)
    assert light() > 0


def test_degenerate_and_duplicate_triangles_do_no_harm(tracer_of):
    mesh = plane(0.0)
    broken = Mesh(
        mesh.vertices, np.concatenate([[[0, 0, 1], [2, 2, 2]], mesh.triangles, mesh.triangles])
    )
    directions = np.tile([0.0, 0, -1], (4, 1))
    origin = np.array([[0.1, 0.05, 1], [-0.1, 0.02, 1], [0.05, -0.2, 1], [0.9, 0, 1]])
    hits = tracer_of(broken).first_hits(origin, directions)
    assert (hits.triangle[:3] >= 2).all() and hits.triangle[3] == -1
    assert np.isfinite(hits.barycentric).all()
