"""Radiance of skin and each of its derivatives, against the formula written out and differences."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.brdf import ALBEDO_MAX, K_DIFFUSE, K_SPECULAR
from facestage.fit.forward.reflectance import (
    Skin,
    albedo_of,
    albedo_seen,
    by_albedo,
    by_c_spec,
    by_log,
)

PIXELS, LIGHTS = 7, 4
STEP = 1e-6


@pytest.fixture
def drawn() -> tuple[Skin, np.ndarray, np.ndarray]:
    """Skin, and what each light gives its pixels (P, N): irradiance and lobe."""
    random = np.random.default_rng(4)
    skin = Skin(random.uniform(0.1, 0.9, (PIXELS, 3)), random.uniform(0.2, 1.5, PIXELS))
    irradiance, lobe = random.uniform(0, 2, (2, PIXELS, LIGHTS))
    return skin, irradiance, lobe


def test_radiance_is_the_formula(drawn):
    skin, irradiance, lobe = drawn
    for pixel in range(PIXELS):
        for channel in range(3):
            e, s = irradiance[pixel, channel], lobe[pixel, channel]
            wanted = K_DIFFUSE * skin.albedo[pixel, channel] / np.pi * e
            wanted += K_SPECULAR * skin.c_spec[pixel] * s
            found = skin.radiance(irradiance[:, :3], lobe[:, :3])[pixel, channel]
            assert found == pytest.approx(wanted, rel=1e-12)


def test_the_lights_images_add_up_to_the_picture(drawn):
    skin, irradiance, lobe = drawn
    color = np.random.default_rng(1).uniform(0, 2, (LIGHTS, 3))
    wanted = skin.radiance(irradiance @ color, lobe @ color)
    images = list(skin.by_light(irradiance, lobe))
    assert len(images) == 3
    np.testing.assert_array_equal(skin.by_lights(irradiance, lobe), images)
    for channel, image in enumerate(images):
        np.testing.assert_allclose(image @ color[:, channel], wanted[:, channel], rtol=1e-12)


def test_more_axes_are_more_of_the_same(drawn):
    skin, irradiance, lobe = drawn
    deep = irradiance[:, :3, None] * np.ones(2), lobe[:, :3, None] * np.ones(2)
    flat = skin.radiance(irradiance[:, :3], lobe[:, :3])
    np.testing.assert_array_equal(skin.radiance(*deep), flat[..., None] * np.ones(2))
    pairs = irradiance.reshape(PIXELS, 2, 2), lobe.reshape(PIXELS, 2, 2)
    for image, deep_image in zip(
        skin.by_light(irradiance, lobe), skin.by_light(*pairs), strict=True
    ):
        np.testing.assert_array_equal(deep_image.reshape(PIXELS, LIGHTS), image)


def test_images_have_the_kind_of_number_that_is_asked_for(drawn):
    skin, irradiance, lobe = drawn
    single = irradiance.astype(np.float32), lobe.astype(np.float32)
    for wanted, found in zip(
        skin.by_light(irradiance, lobe), skin.by_light(*single, np.float32), strict=True
    ):
        assert wanted.dtype == np.float64 and found.dtype == np.float32
        np.testing.assert_allclose(found, wanted, rtol=1e-6)


@pytest.mark.parametrize("name", ["albedo", "c_spec"])
def test_derivatives_are_differences(drawn, name: str):
    skin, irradiance, lobe = drawn
    e, s = irradiance[:, :3], lobe[:, :3]

    def moved(step: float) -> np.ndarray:
        albedo, c_spec = skin.albedo, skin.c_spec
        if name == "albedo":
            return Skin(albedo + step, c_spec).radiance(e, s)
        return Skin(albedo, c_spec + step).radiance(e, s)

    wanted = (moved(STEP) - moved(-STEP)) / (2 * STEP)
    found = by_albedo(e) if name == "albedo" else by_c_spec(s)
    np.testing.assert_allclose(found, wanted, rtol=1e-6)


def test_by_log_albedo_stops_where_the_albedo_is_limited(drawn):
    skin, irradiance, lobe = drawn
    e, s = irradiance[:, :3], lobe[:, :3]
    logs = np.log(skin.albedo)
    logs[::2, 1] = 0.5
    limited = Skin(albedo_of(logs), skin.c_spec)
    assert limited.albedo.max() == ALBEDO_MAX
    ahead, behind = (
        Skin(albedo_of(logs + step), skin.c_spec).radiance(e, s) for step in (STEP, -STEP)
    )
    wanted = (ahead - behind) / (2 * STEP)
    np.testing.assert_allclose(limited.by_log_albedo(e), wanted, rtol=1e-5, atol=1e-9)
    np.testing.assert_allclose(by_log(by_albedo(e), limited.albedo), wanted, rtol=1e-5, atol=1e-9)


def test_the_albedo_is_found_again_in_the_color(drawn):
    skin, irradiance, lobe = drawn
    e, s = irradiance[:, :3] + 0.1, lobe[:, :3]
    found = albedo_seen(skin.radiance(e, s), by_albedo(e), skin.gloss(s))
    np.testing.assert_allclose(found, skin.albedo, rtol=1e-9)


def test_dimmed_skin_sends_back_its_share(drawn):
    skin, irradiance, lobe = drawn
    e, s = irradiance[:, :3], lobe[:, :3]
    np.testing.assert_allclose(skin.dimmed(0.25).radiance(e, s), 0.25 * skin.radiance(e, s))


def test_a_part_is_some_of_the_points(drawn):
    skin, irradiance, lobe = drawn
    where = np.array([5, 0, 3])
    found = skin.part(where).radiance(irradiance[where, :3], lobe[where, :3])
    np.testing.assert_array_equal(found, skin.radiance(irradiance[:, :3], lobe[:, :3])[where])
