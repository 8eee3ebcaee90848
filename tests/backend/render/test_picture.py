"""Whole pictures of the float32 tracer against float64 numpy: rays, shadows, shading, and a stage
far away.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.brdf import ALBEDO_MAX, K_DIFFUSE, K_SPECULAR
from facestage.contract.light_stage import LightStage
from facestage.fit.face.state import State
from facestage.fit.forward.shading import sample_bilinear
from reference.rendering.area_light import direct_light, keyed_lattice
from reference.rendering.cook_torrance import normalize
from reference.rendering.intersect import first_hits
from reference.synthetic_scene import Scene, synthetic_scene

SIDE, SAMPLES, SEED = 20, 2, 9
SHADOW_OFFSET = 2e-4


@pytest.fixture(scope="module")
def scene(renderer: str) -> Scene:
    return synthetic_scene(side=SIDE)


def reference_picture(scene: Scene, state: State, stage: LightStage) -> np.ndarray:
    """(SIDE, SIDE, 3) radiance in float64, every ray against every triangle; NaN where nothing is
    hit.
    """
    model, geometry, camera = scene.model, scene.geometry, state.camera
    bases = np.concatenate([model.identity_basis, model.expression_basis]).astype(float)
    shape = model.vertices.astype(float) + np.tensordot(
        np.concatenate([state.identity, state.expression]), bases, 1
    )
    vertices = shape @ state.rotation.T + state.translation
    a, b, c = (vertices[geometry.triangles[:, corner]] for corner in range(3))
    faces = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, geometry.triangles[:, corner], faces)
    normals = normalize(normals)

    y, x = (axis.ravel() for axis in np.mgrid[:SIDE, :SIDE])
    across, up = x + 0.5 - camera.principal_px[0], camera.principal_px[1] - y - 0.5
    rays = normalize(np.stack([across, up, np.full(len(x), -camera.focal_px)], axis=1))
    triangle, weights, distance = first_hits(np.zeros(3), rays, vertices, geometry.triangles)
    hit = triangle >= 0
    corners, weights, rays = geometry.triangles[triangle[hit]], weights[hit], rays[hit]
    points = distance[hit, None] * rays
    shading = normalize(np.einsum("pi,pix->px", weights, normals[corners]))
    facing = normalize(faces[triangle[hit]])
    facing *= -np.sign((facing * rays).sum(1, keepdims=True))
    square = keyed_lattice((y[hit] << 16) + x[hit], len(stage), SAMPLES, SEED)
    diffuse, specular = direct_light(
        points,
        shading,
        -rays,
        stage,
        state.roughness,
        square,
        points + SHADOW_OFFSET * facing,
        (vertices, geometry.triangles),
    )
    logs = np.log(model.albedo_mean) + np.tensordot(
        state.albedo, model.albedo_basis.astype(float), 1
    )
    albedo = np.minimum(np.exp(np.einsum("pi,pic->pc", weights, logs[corners])), ALBEDO_MAX)
    uvs = np.einsum(
        "pi,pix->px", weights, model.uvs.astype(float)[geometry.triangle_uvs[triangle[hit]]]
    )
    c_spec = sample_bilinear(state.specular, uvs)[:, None]
    picture = np.full((SIDE, SIDE, 3), np.nan)
    color = K_DIFFUSE / np.pi * albedo * (diffuse @ stage.radiance)
    picture[y[hit], x[hit]] = color + K_SPECULAR * c_spec * (specular @ stage.radiance)
    return picture


@pytest.mark.parametrize("metres", [0.0, 1e3, 1e6])
def test_a_picture_equals_the_reference_wherever_the_stage_is(scene: Scene, metres: float) -> None:
    wanted = reference_picture(scene, scene.state, scene.stage)
    # The same lights, said in the frame of a stage whose origin is that far away and that is
    # turned.
    to_stage = np.eye(4)
    to_stage[:3, :3] = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    to_stage[:3, 3] = metres * np.array([0.6, -0.48, 0.64])
    stage = scene.stage.transformed(to_stage).transformed(np.linalg.inv(to_stage))
    found, seen = replace(scene, stage=stage).render(samples=SAMPLES, seed=SEED)
    known = np.isfinite(wanted).all(axis=2)
    assert (seen != known).mean() < 0.01, "silhouettes"
    both = seen & known
    error = np.abs(found[both] - wanted[both]).max(axis=1) / np.median(wanted[both])
    # A shadow ray that just misses in one precision just hits in the other.
    print(
        f"stage {metres:g} m away: float32 against float64, median {np.median(error):.1e}, 95 % "
        f"below {np.percentile(error, 95):.1e}, {100 * (error > 1e-2).mean():.1f} % of pixels "
        "differ by a shadow's edge"
    )
    assert np.median(error) < 1e-4
    assert (error > 1e-2).mean() < 0.03
