"""How much a residual counts, in numbers done by hand."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.energy.noise import NoiseModel, estimate_noise

SIZE = 192
EVERYWHERE = np.ones((SIZE, SIZE), bool)


def estimated(relative: np.ndarray, used: np.ndarray = EVERYWHERE) -> NoiseModel:
    """Of residuals that are ``relative`` to the level midway between photo and model, and 0.15 of
    the photo's.
    """
    residual = relative * 0.4 * 1.15 / (1 - 0.5 * relative)
    return estimate_noise(residual[..., None] * np.ones(3), np.full((*used.shape, 3), 0.4), used)


def white(sigma: float) -> np.ndarray:
    return sigma * np.random.default_rng(0).normal(size=(SIZE, SIZE))


def test_a_pixel_s_channel_counts_for_a_third_of_its_share_of_the_area():
    assert NoiseModel(0.1, 10.0, 0.1, np.ones((1, 1))).information() == pytest.approx(1 / 30)


def test_the_floor_is_a_share_of_the_face_s_own_mean():
    photo = np.full((4, 4, 3), 0.4)
    photo[2:] = 9.0
    used = np.zeros((4, 4), bool)
    used[:2] = True
    assert estimate_noise(np.zeros((4, 4, 3)), photo, used).floor == pytest.approx(0.15 * 0.4)
    assert estimate_noise(np.zeros((4, 4, 3)), photo, ~used & False).floor == 1.0


def test_the_area_lies_between_four_pixels_and_a_fiftieth_of_the_face():
    assert estimated(white(1e-3) * 0 + white(1e-2)).area == 4.0
    smooth = np.full((SIZE, SIZE), 0.01)
    assert estimated(smooth).area == pytest.approx(0.02 * SIZE**2)
    # Fewer than four blocks tell nothing of correlation: a quarter of a block.
    assert estimated(np.full((1, 1), 0.01), np.ones((1, 1), bool)).area == 1.0


def test_misfits_of_a_quarter_of_the_face_are_one_observation():
    """Waves that a block of a quarter of the face's side sees, and one of half of it does not."""
    y, x = np.mgrid[:SIZE, :SIZE] // (SIZE // 4)
    waves = 4e-3 * np.where((x + y) % 2, 1.0, -1.0)
    both = waves + white(1.2e-2)
    # Block means have the waves' variance, (4e-3)^2, plus the noise's share; each block has 48^2
    # pixels.
    wanted = (16e-6 + 1.44e-4 / 48**2) / (16e-6 + 1.44e-4) * 48**2
    assert estimated(both).area == pytest.approx(wanted, rel=0.15)


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_wild_pixel_adds_two_and_a_half_deviations_to_the_correlation(sign: int):
    relative = white(1e-2)
    wild = relative.copy()
    wild[5:25, 5:25] = sign * 0.5
    clipped = relative.copy()
    clipped[5:25, 5:25] = sign * 2.5 * estimated(wild).sigma
    assert estimated(wild).area == pytest.approx(estimated(clipped).area, rel=0.02)


def test_a_region_counts_by_the_cube_of_its_excess_whatever_lies_beside_the_face():
    relative = white(1e-2)
    sigma = estimated(relative).sigma
    relative[60:130, 60:130] = 4 * sigma
    used = EVERYWHERE.copy()
    used[:, 150:] = False
    relative[:, 150:] = np.where(np.arange(42) % 2, 1.5, -3.0)
    noise = estimated(relative, used)
    # In the region's middle all pixels around are four deviations off; 2.5 are nothing unusual.
    level = 4 * sigma / noise.sigma
    assert noise.excess[95, 95] == pytest.approx((level / 2.5) ** 3, rel=0.02)
    assert noise.excess[20:40, 20:40].max() == 1.0 and np.isfinite(noise.excess).all()
    assert noise.excess[20:40, 135:149].max() == 1.0, "what is not used is no neighbor"
    # A single pixel adds six deviations at most.
    relative[60:130, 60:130] = 50 * sigma
    noise = estimated(relative, used)
    assert noise.excess[95, 95] == pytest.approx((6 / 2.5) ** 3, rel=0.02)
