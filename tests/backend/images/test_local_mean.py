"""Means around each pixel, beside plain sums over all pixels."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from facestage.images.local_mean import CELLS, TRUNCATE, local_mean


def _picture(rows: int, columns: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(0)
    smooth = gaussian_filter(random.normal(size=(rows, columns, 2)), (6, 6, 0), mode="wrap")
    values = smooth / smooth.std() + 0.3 * random.normal(size=smooth.shape)
    weight = random.uniform(size=(rows, columns)) * (np.arange(columns) < 0.8 * columns)
    return values, weight


def _by_sums(values: np.ndarray, weight: np.ndarray, sigma: float, at: tuple[int, int]):
    y, x = np.mgrid[: weight.shape[0], : weight.shape[1]] - np.reshape(at, (2, 1, 1))
    share = np.exp(-0.5 * (x**2 + y**2) / sigma**2) * weight
    share *= (np.abs(x) <= TRUNCATE * sigma + 0.5) & (np.abs(y) <= TRUNCATE * sigma + 0.5)
    return np.einsum("yx,yxc->c", share, values) / share.sum()


@pytest.mark.parametrize(("sigma", "within"), [(3.0, 1e-5), (2.7 * CELLS, 0.02), (34.0, 0.02)])
def test_they_are_gaussian_means_by_weight(sigma: float, within: float) -> None:
    """A narrow one is exact; a wide one is off by little of what the values vary by."""
    values, weight = _picture(93, 121)
    found = local_mean(values, weight, sigma)
    for at in ((0, 0), (46, 60), (92, 90), (31, 77), (60, 5)):
        np.testing.assert_allclose(found[at], _by_sums(values, weight, sigma, at), atol=within)


@pytest.mark.parametrize("sigma", [2.0, 21.0])
def test_what_is_even_stays_and_what_weighs_nothing_tells_nothing(sigma: float) -> None:
    values, weight = _picture(80, 200)
    even = np.full_like(values, 5.0)
    even[:, 160:] = 1e3
    found = local_mean(even, weight, sigma)
    np.testing.assert_allclose(found[:, :160], 5.0, rtol=1e-5)
    assert (local_mean(values, np.zeros_like(weight), sigma) == 0.0).all()
