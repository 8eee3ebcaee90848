"""Scale and correlation of residuals, recovered from noise that is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from facestage.fit.energy.noise import (
    AREA_MIN,
    HIGHLIGHT_SHARE,
    SIGMA_MIN,
    NoiseModel,
    estimate_noise,
)

SIZE = 192
PHOTO = np.full((SIZE, SIZE, 3), 0.4)
EVERYWHERE = np.ones((SIZE, SIZE), bool)


def correlated(width: float, sigma: float, seed: int = 0) -> np.ndarray:
    """(SIZE, SIZE, 3) relative residuals of known deviation, each channel smoothed by a Gaussian of
    ``width`` px.
    """
    noise = np.random.default_rng(seed).normal(size=(SIZE, SIZE, 3))
    if width:
        noise = np.stack(
            [gaussian_filter(noise[..., c], width, mode="wrap") for c in range(3)], axis=2
        )
    return sigma * noise / noise.std()


def residual_of(relative: np.ndarray) -> np.ndarray:
    """Residuals whose size relative to the middle of model and photo (and the floor) is
    ``relative``.
    """
    floor = 0.15 * 0.4
    residual = relative * (0.4 + floor)
    for _ in range(30):
        residual = relative * ((PHOTO + 0.5 * residual).mean(-1, keepdims=True) + floor)
    return residual


@pytest.mark.parametrize("sigma", [0.02, 0.1])
def test_sigma_of_white_noise(sigma: float):
    noise = estimate_noise(residual_of(correlated(0, sigma)), PHOTO, EVERYWHERE)
    print(f"white noise of {sigma}: estimated {noise.sigma:.4f}, area {noise.area:.1f}")
    assert noise.sigma == pytest.approx(sigma, rel=0.05)
    assert noise.area == pytest.approx(AREA_MIN, rel=0.5), (
        "uncorrelated pixels count one by one, to the least area"
    )


@pytest.mark.parametrize("width", [1.5, 2.5, 4.0])
def test_area_of_correlated_noise(width: float):
    """A Gaussian filter correlates an area of 4 pi width^2 pixels."""
    areas = [
        estimate_noise(residual_of(correlated(width, 0.05, seed)), PHOTO, EVERYWHERE).area
        for seed in range(4)
    ]
    wanted = 4 * np.pi * width**2
    print(f"width {width}: area {np.mean(areas):.0f}, true {wanted:.0f}")
    assert 0.4 * wanted < np.mean(areas) < 1.4 * wanted


def test_outliers_do_not_move_sigma():
    relative = correlated(0, 0.05)
    relative[np.random.default_rng(1).random((SIZE, SIZE)) < 0.1] = 3.0
    noise = estimate_noise(
        residual_of(correlated(0, 0.05)) + (relative > 2) * 0.5, PHOTO, EVERYWHERE
    )
    assert noise.sigma < 0.07


def test_perfect_residuals_and_no_pixels_are_finite():
    perfect = estimate_noise(np.zeros((SIZE, SIZE, 3)), PHOTO, EVERYWHERE)
    assert perfect.sigma == SIGMA_MIN and np.isfinite([perfect.area, perfect.floor]).all()
    nothing = estimate_noise(np.zeros((SIZE, SIZE, 3)), PHOTO, ~EVERYWHERE)
    assert (
        np.isfinite([nothing.sigma, nothing.area, nothing.floor]).all()
        and nothing.information() > 0
    )
    black = estimate_noise(np.zeros((8, 8, 3)), np.zeros((8, 8, 3)), np.ones((8, 8), bool))
    assert np.isfinite([black.sigma, black.area, black.floor]).all() and black.floor > 0


@pytest.mark.parametrize("shape", [(1, 1), (3, 40), (17, 5)])
def test_any_shape(shape: tuple[int, int]):
    random = np.random.default_rng(0)
    noise = estimate_noise(
        random.normal(size=(*shape, 3)) * 0.01, np.full((*shape, 3), 0.5), np.ones(shape, bool)
    )
    assert np.isfinite([noise.sigma, noise.area, noise.floor]).all()


def test_too_dark_and_too_bright_by_the_same_factor_cost_the_same():
    noise, matte = NoiseModel(0.1, 10.0, 1e-9, np.ones((1, 1))), np.zeros((1, 1, 1))
    photo = np.full((1, 1, 3), 0.4)
    standardized = [
        (factor - 1) * photo / noise.scale(photo, (factor - 1) * photo, matte)
        for factor in (0.5, 2.0)
    ]
    np.testing.assert_allclose(np.abs(standardized[0]), np.abs(standardized[1]), rtol=1e-6)


def test_a_highlight_is_less_certain_than_matte_skin():
    noise, photo = NoiseModel(0.1, 10.0, 1e-9, np.ones((1, 1))), np.full((1, 2, 3), 0.4)
    scale = noise.scale(photo, np.zeros_like(photo), np.array([[[0.0], [0.2]]]))
    assert scale[0, 0, 0] == pytest.approx(0.04)
    assert scale[0, 1, 0] == pytest.approx(0.04 + HIGHLIGHT_SHARE * 0.2)


def test_robust_weights_are_shared_by_the_channels_and_fall():
    noise = NoiseModel(0.1, 10.0, 0.1, np.ones((1, 1)))
    weights = noise.robust(np.array([[0.0, 0, 0], [2.5, 2.5, 2.5], [100.0, 0, 0]]))
    assert weights.shape == (3, 1)
    np.testing.assert_allclose(weights[:2, 0], [1.0, 0.5])
    assert weights[2, 0] < 0.01


def test_a_region_that_is_wrong_counts_for_next_to_nothing_and_the_rest_as_before():
    relative = correlated(0, 0.05)
    relative[20:80, 20:80] -= 0.5  # a beard: ten times the skin's own noise
    noise = estimate_noise(residual_of(relative), PHOTO, EVERYWHERE)
    assert (noise.excess[35:65, 35:65] > 5).all()
    assert (noise.excess[130:, 130:] == 1).all()


def test_noise_alone_is_no_region_that_is_wrong():
    for width in (0, 2.5):
        noise = estimate_noise(residual_of(correlated(width, 0.05)), PHOTO, EVERYWHERE)
        assert noise.excess.max() < 1.05, width
