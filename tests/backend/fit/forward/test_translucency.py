"""Light that comes out of the skin unevenly: more of it at a slant and where the skin bulges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.brdf import ALBEDO_MAX, K_DIFFUSE
from facestage.contract.scattering import BULGE, CURVATURE_MAX, DISTANCE_MM, METRES, SLANT, emerging
from facestage.fit.face.unknowns import TRANSLUCENCY_MAX
from facestage.fit.forward.reflectance import Skin
from facestage.fit.forward.rendering import Textures, render_picture
from reference.synthetic_scene import Scene

# What Cycles' random walk adds (docs/transport.md): of albedo K a, by the cosine of the view.
CYCLES = {
    (0.6, 0.95): -0.029,
    (0.6, 0.35): 0.042,
    (0.42, 0.95): -0.046,
    (0.42, 0.35): 0.066,
    (0.21, 0.95): -0.065,
    (0.21, 0.35): 0.080,
    (0.1, 0.95): -0.070,
    (0.1, 0.35): 0.091,
}


@pytest.mark.parametrize(("share", "cosine"), CYCLES)
def test_skin_seen_at_a_slant_is_brighter_as_in_cycles(share: float, cosine: float):
    found = emerging(share / K_DIFFUSE, SLANT * (2 / 3 - cosine)) - 1
    assert found == pytest.approx(CYCLES[share, cosine], abs=0.016)


def test_all_of_the_light_that_leaves_is_as_much():
    """Radiance times cosine over the hemisphere."""
    cosine = (np.arange(1000) + 0.5) / 1000
    mean = (2 * cosine * emerging(0.4, SLANT * (2 / 3 - cosine))).mean()
    assert mean == pytest.approx(1.0, abs=1e-6)


def test_no_skin_sends_less_than_nothing():
    least = -SLANT / 3 - BULGE * METRES * DISTANCE_MM[0] * CURVATURE_MAX
    assert emerging(0.0, TRANSLUCENCY_MAX * least) > 0.1


def test_the_pixels_have_what_the_contract_says(scene: Scene):
    """Of the surface that each sees, and of skin alone."""
    forward, state = scene.forward, replace(scene.state, translucency=0.8)
    pixels = np.stack(np.meshgrid(np.arange(20, 76, 7), np.arange(20, 76, 7)), -1).reshape(-1, 2)
    surface = forward.surface(state, pixels + 0.5)
    terms = forward.light_terms(state, surface, scene.stage, 4, 0)
    plain = forward.shade(replace(state, translucency=0.0), surface, terms)
    image = forward.shade(state, surface, terms)
    bends = scene.geometry.bends.of(surface.model_vertices)
    for pixel in range(len(surface.pixels)):
        cosine = -surface.normals[pixel] @ surface.rays[pixel]
        bend = surface.weights[pixel] @ bends[surface.corners[pixel]]
        for channel in range(3):
            depth = METRES * DISTANCE_MM[channel]
            excess = 0.8 * (SLANT * (2 / 3 - cosine) + BULGE * depth * bend)
            more = 1 + (1 - K_DIFFUSE * plain.albedo[pixel, channel]) * excess
            gloss = plain.skin.gloss(plain.specular)[pixel, channel]
            wanted = more * (plain.color[pixel, channel] - gloss) + gloss
            assert image.color[pixel, channel] == pytest.approx(wanted, rel=1e-6)


def test_the_derivative_by_the_albedo():
    rng = np.random.default_rng(1)
    albedo, excess = rng.uniform(0.1, 0.9, (5, 3)), rng.uniform(-0.3, 0.4, (5, 3))
    albedo[0] = ALBEDO_MAX
    light, step = rng.uniform(0.5, 2, (5, 3)), 1e-6
    plus, minus = (
        Skin(np.minimum(albedo * np.exp(sign * step), ALBEDO_MAX), np.zeros(5), excess)
        for sign in (1, -1)
    )
    found = Skin(albedo, np.zeros(5), excess).by_log_albedo(light)
    wanted = (plus.matte(light) - minus.matte(light)) / (2 * step)
    np.testing.assert_allclose(found[1:], wanted[1:], rtol=1e-6)
    assert not found[0].any()


def test_relighting_has_it_to_the_last_digit(scene: Scene):
    """The sum of the images of single lights is the picture, and none of them is opaque skin's."""
    maps = Textures(np.full((8, 8, 3), 0.4), np.full((8, 8), 0.5))
    stage = scene.stage.with_radiance(scene.lights.radiance(scene.state.lights))
    plain, uneven = (
        render_picture(
            scene.forward,
            replace(scene.state, translucency=strength),
            stage,
            maps,
            samples=4,
            by_light=True,
        )
        for strength in (0.0, 1.0)
    )
    assert np.abs(uneven.color - plain.color).max() > 0.02 * plain.color.max()
    assert uneven.by_light is not None
    total = np.stack(
        [uneven.by_light.colors[channel] @ stage.radiance[:, channel] for channel in range(3)], -1
    )
    shown = uneven.color.reshape(-1, 3)[uneven.by_light.pixels]
    np.testing.assert_allclose(total, shown, atol=1e-4 * shown.max())
