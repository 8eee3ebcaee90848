"""How light from skin to skin changes with the shape: in a sphere that is bent, and where it is
none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.forward import bounces, moving_bounces
from facestage.fit.forward.bounces import Bounces
from facestage.fit.forward.moving_bounces import Turning, Views
from facestage.fit.forward.shading import ForwardModel
from facestage.render.light_terms import Asked
from facestage.render.tracer import RayTracer
from facestage.render.variant import start_renderer
from reference.closed_room import RADIUS, inside_of_a_sphere
from reference.synthetic_scene import Scene, synthetic_scene

SEED = 3
STEP = 1e-4


@pytest.fixture(scope="module", autouse=True)
def renderer() -> None:
    start_renderer("cpu")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return synthetic_scene()


def received(room: Bounces, vertices: np.ndarray, sent: np.ndarray) -> np.ndarray:
    """(points,) what each point receives of patches that send so much, triangle by triangle."""
    triangles = room.geometry.triangles
    area = room.geometry.face_normals(vertices) / 2
    way = vertices[triangles].mean(axis=1) - vertices[room.points][:, None]
    square = (way**2).sum(-1)
    square[(triangles == room.points[:, None, None]).any(-1)] = np.inf  # flat beside the point
    normals = room.geometry.vertex_normals(vertices)[0][room.points]
    here, there = np.einsum("px,ptx->pt", normals, way), -np.einsum("tx,ptx->pt", area, way)
    return (here * there / (np.pi * square**2)) @ sent[room.patch_of_triangle]


@pytest.mark.parametrize(
    "bend",
    [
        lambda place: place * [1.0, 0.0, 0.0],
        lambda place: place[:, [1, 2, 0]] * [0.0, 1.0, 0.0],
        lambda place: 10.0 * place[:, :1] * place,
    ],
    ids=["wide", "askew", "bulging"],
)
@pytest.mark.parametrize("even", [True, False])
def test_in_a_sphere_that_is_bent_points_see_more_of_what_comes_near(
    bend, even: bool, monkeypatch: pytest.MonkeyPatch
):
    """By rays that all count. Where all patches send alike, hardly anything changes: all of a
    closed room is seen.
    """
    monkeypatch.setattr(bounces, "RAYS", 400)
    monkeypatch.setattr(moving_bounces, "COSINE_MIN", 0.02)
    monkeypatch.setattr(moving_bounces, "LENGTH_MIN", 1e-4)
    geometry = inside_of_a_sphere(24)
    vertices, room = geometry.mean, Bounces(geometry)
    tracer = RayTracer(geometry.triangles, len(vertices))
    tracer.update(vertices)
    turning = Turning(geometry, vertices, room.points, *geometry.vertex_normals(vertices))
    hits = room.hits(tracer, vertices[room.points], turning.normals)
    middles = vertices[room.points[: room.members.shape[0]]]
    sent = np.ones(len(middles)) if even else 2.0 + middles.sum(axis=1) / RADIUS
    motion = bend(vertices)
    basis = motion.astype(np.float32).reshape(-1, 1)
    shares = Views.of(turning, hits).changes(basis, turning.motion(basis))[:, 0]
    ray = sent[room.patch_of_triangle[hits.triangle]] / 400
    found = np.bincount(hits.point, ray * shares, len(room.points))
    wanted = received(room, vertices + STEP * motion, sent)
    wanted = (wanted - received(room, vertices - STEP * motion, sent)) / (2 * STEP)
    error = np.sqrt(((found - wanted) ** 2).mean())
    size = 1.0 if even else np.sqrt((wanted**2).mean())
    print(f"error {error:.1e} of {size:.1e}")
    assert error < (0.01 if even else 0.1) * size


def test_light_that_is_none_or_held_has_no_derivative(scene: Scene):
    resting = ForwardModel(scene.geometry, scene.lights, resting=True)
    for forward, strength in ((scene.forward, 0.0), (resting, 1.0), (scene.forward, 1.0)):
        state = replace(scene.state, interreflection=strength)
        surface = forward.surface(state, np.array([[48.5, 48.5]]))
        terms = forward.light_terms(state, surface, scene.stage, 2, SEED, Asked(by_surface=True))
        image = forward.shade(state, surface, terms)
        found = moving_bounces.moving_bounces(forward, state, image, scene.stage, SEED)
        assert (found is None) == (forward is resting or strength == 0)
