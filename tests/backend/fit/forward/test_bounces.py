"""Light from skin to skin: against what is known of an integrating sphere, and in pictures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract import brdf
from facestage.contract.light_stage import LightStage
from facestage.fit.forward.bounces import Bounces
from facestage.fit.forward.one_light import OneLightImages
from facestage.fit.forward.reflectance import UNIFORM
from facestage.render.tracer import RayTracer
from facestage.render.variant import start_renderer
from reference.closed_room import RADIUS, SIDE, inside_of_a_sphere, lamp_in_the_middle
from reference.synthetic_scene import Scene, synthetic_scene


@pytest.fixture(scope="module", autouse=True)
def renderer() -> None:
    start_renderer("cpu")


@pytest.fixture(scope="module")
def scene() -> Scene:
    return synthetic_scene()


def test_an_integrating_sphere_is_lit_evenly():
    """Every point sees all others alike: a D + a^2 D + ... of the mean direct light D (Jacquez &
    Kuppenheim 1955), however unevenly the lamp lights it.
    """
    geometry = inside_of_a_sphere()
    tracer = RayTracer(geometry.triangles, len(geometry.mean))
    tracer.update(geometry.mean)
    albedo, c_spec = np.array([0.6, 0.3, 0.1]), 0.5
    logs = np.broadcast_to(np.log(albedo), geometry.mean.shape)
    bounces, numbers = Bounces(geometry), np.arange(1)
    found = bounces.irradiance(
        tracer, geometry.mean, logs, lamp_in_the_middle(), numbers, c_spec, seed=0
    )
    share = brdf.K_DIFFUSE * albedo + UNIFORM * c_spec
    flux, area = np.pi * SIDE**2, 4 * np.pi * RADIUS**2
    expected = flux / area * share / (1 - share)
    np.testing.assert_allclose(found.mean(axis=1)[:, 0], expected, rtol=0.05)
    assert found[:, :, 0].std(axis=1).max() < 0.1 * expected.max()


def test_a_light_that_is_not_traced_sends_nothing():
    geometry = inside_of_a_sphere(16)
    tracer = RayTracer(geometry.triangles, len(geometry.mean))
    tracer.update(geometry.mean)
    logs, one = np.full(geometry.mean.shape, -1.0), lamp_in_the_middle()
    both = LightStage(
        *(np.concatenate([value, value]) for value in vars(one).values())  # type: ignore[arg-type]
    )
    found = Bounces(geometry).irradiance(
        tracer, geometry.mean, logs, both, np.arange(2), 0.0, 0, np.array([True, False])
    )
    assert found[:, :, 0].min() > 0 and not found[:, :, 1].any()


def test_pixels_take_what_the_points_around_them_receive(scene: Scene):
    """A smooth field over the face is found again."""
    bounces, geometry = scene.forward.bounces, scene.geometry
    field = 1 + 5 * geometry.mean[:, 0] + 3 * geometry.mean[:, 1]
    received = np.broadcast_to(field[bounces.points], (3, len(bounces.points)))[..., None]
    corners = geometry.triangles
    found = bounces.at_pixels(
        received.astype(np.float32), corners, np.full((len(corners), 3), 1 / 3)
    )
    assert np.abs(found[0, :, 0] - field[corners].mean(axis=1)).max() < 0.1 * np.ptp(field)


def test_a_pixel_on_a_point_takes_most_of_that_point(scene: Scene):
    """Else creases would be smeared: the points around one may face elsewhere."""
    bounces = scene.forward.bounces
    some = bounces.points[::20]
    received = np.zeros((3, len(bounces.points), len(some)), np.float32)
    received[:, ::20] = np.eye(len(some))
    found = bounces.at_pixels(
        received, np.repeat(some[:, None], 3, axis=1), np.full((len(some), 3), 1 / 3)
    )
    assert np.diag(found[0]).min() > 0.5


def test_a_face_at_rest_says_once_which_skin_lights_which():
    """A sphere twice as large sees of itself what the small one does."""
    geometry = inside_of_a_sphere(24)
    tracer = RayTracer(geometry.triangles, len(geometry.mean))
    logs, lamp = np.full(geometry.mean.shape, -1.0), lamp_in_the_middle()
    resting, found = Bounces(geometry, resting=True), []
    for bounces in (resting, Bounces(geometry), resting):
        tracer.update(2 * geometry.mean)
        found.append(bounces.irradiance(tracer, 2 * geometry.mean, logs, lamp, np.arange(1), 0, 0))
        # The mesh is where it was before: a ray from beyond the small sphere hits it.
        beyond = np.array([1.5 * RADIUS, 0.01, 0.02])
        assert (tracer.first_hits(beyond, np.eye(3)[:1]).triangle >= 0).all()
    np.testing.assert_array_equal(found[2], found[0])
    assert np.abs(found[0] - found[1]).mean() < 0.01 * found[1].mean()
    geometry.mean = geometry.mean * [1, 1, 0.2]  # unheeded from now on
    tracer.update(2 * geometry.mean)
    again = resting.irradiance(tracer, 2 * geometry.mean, logs, lamp, np.arange(1), 0, 0)
    flat = Bounces(geometry).irradiance(tracer, 2 * geometry.mean, logs, lamp, np.arange(1), 0, 0)
    assert np.abs(again - flat).mean() > 0.1 * flat.mean()


def test_a_mesh_that_moved_is_looked_at_anew():
    """What was seen of the last one is not."""
    geometry = inside_of_a_sphere(24)
    tracer = RayTracer(geometry.triangles, len(geometry.mean))
    logs, lamp = np.full(geometry.mean.shape, -1.0), lamp_in_the_middle()
    same, found = Bounces(geometry), []
    for width in (1.0, 0.3, 0.3, 1.0):
        vertices = geometry.mean * [1, 1, width]
        tracer.update(vertices)
        asked = (tracer, vertices, logs, lamp, np.arange(1), 0, 0)
        found.append(same.irradiance(*asked))
        np.testing.assert_array_equal(found[-1], Bounces(geometry).irradiance(*asked))
    assert np.abs(found[0] - found[1]).mean() > 0.1 * found[0].mean()


def test_a_face_without_it_is_as_it_was_and_lights_add_up(scene: Scene):
    pixels = np.stack(np.meshgrid(np.arange(96), np.arange(96)), -1).reshape(-1, 2) + 0.5
    forward, none = scene.forward, scene.state
    some = replace(none, interreflection=0.8)
    surface = forward.surface(none, pixels)
    direct, whole = (
        forward.light_terms(state, surface, scene.stage, 4, 0) for state in (none, some)
    )
    assert not direct.indirect.size and whole.indirect.shape == (3, *whole.diffuse.shape)
    np.testing.assert_array_equal(direct.diffuse, whole.diffuse)
    image = forward.shade(some, surface, whole)
    less = forward.shade(none, surface, direct)
    assert (image.color >= less.color).all() and (image.color > 1.001 * less.color).any()
    x, y = surface.pixels.astype(int).T
    images = OneLightImages(some.camera, pixels.astype(int), len(scene.stage))
    images.add(x, y, 1.0, whole, image.skin)
    for channel in range(3):
        total = images.colors[channel][96 * y + x] @ image.radiance[:, channel]
        np.testing.assert_allclose(total, image.color[:, channel], rtol=1e-4, atol=1e-6)
