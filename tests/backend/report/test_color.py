from __future__ import annotations

import numpy as np
import pytest

from facestage.report.color import exposure, shrink, to_srgb8


@pytest.mark.parametrize(
    ("linear", "code"),
    [(0.0, 0), (1.0, 255), (0.5, 188), (0.18, 118), (0.0031308, 10), (0.21586, 128)],
)
def test_known_values_of_the_srgb_curve(linear: float, code: int) -> None:
    assert to_srgb8(np.array(linear)) == code


def test_every_code_value_survives_the_round_trip() -> None:
    codes = np.arange(256)
    encoded = codes / 255.0
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    np.testing.assert_array_equal(to_srgb8(linear), codes)


def test_what_is_not_a_number_becomes_black_or_white() -> None:
    np.testing.assert_array_equal(
        to_srgb8(np.array([np.nan, -np.inf, -1.0, np.inf, 7.0])), [0, 0, 0, 255, 255]
    )


def test_a_display_referred_photo_keeps_its_exposure() -> None:
    photo = np.random.default_rng(0).uniform(0, 1, (40, 40, 3))
    assert exposure(photo) == 1.0
    assert exposure(np.zeros((3, 3, 3))) == 1.0
    assert exposure(np.full((3, 3, 3), np.nan)) == 1.0


@pytest.mark.parametrize("scale", [1e-3, 50.0, 1e6])
def test_a_scene_referred_photo_is_exposed_to_its_highlights(scale: float) -> None:
    photo = scale * np.random.default_rng(0).uniform(0, 1, (60, 60, 3))
    photo[0, 0] = np.inf
    assert exposure(photo) * scale == pytest.approx(1.0, rel=0.03)


def test_shrinking_keeps_the_mean_and_the_shape() -> None:
    image = np.random.default_rng(0).uniform(0, 1, (64, 256, 3))
    small = shrink(image, 32)
    assert small.shape == (8, 32, 3)
    np.testing.assert_allclose(small.mean((0, 1)), image.mean((0, 1)), atol=1e-5)
    assert shrink(image[:, :, 0], 32).shape == (8, 32)
    assert shrink(np.full((2000, 1), np.nan), 32).shape == (32, 1)
    np.testing.assert_array_equal(shrink(image, 256), image.astype(np.float32))
