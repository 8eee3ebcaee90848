"""The color of the light where a photo shows something grey."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.grey import color_of_grey

HEIGHT, WIDTH = 20, 30


def photo() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    color = np.full((HEIGHT, WIDTH, 3), [0.5, 0.4, 0.3])
    return color, np.ones((HEIGHT, WIDTH), bool), np.zeros((HEIGHT, WIDTH, 3), bool)


def test_a_few_pixels_count_and_no_more():
    color, usable, clipped = photo()
    color[5:10, 10:15] = np.random.default_rng(0).uniform(0.4, 0.8, (5, 5, 3))
    found = color_of_grey(color, usable, clipped, 12.9, 7.0)
    np.testing.assert_allclose(found, color[5:10, 10:15].mean(axis=(0, 1)))
    clipped[4, 9] = True
    np.testing.assert_array_equal(found, color_of_grey(color, usable, clipped, 12, 7.9))


@pytest.mark.parametrize("corner", [(0, 0), (WIDTH - 0.01, HEIGHT - 0.01)])
def test_there_are_fewer_at_the_border(corner: tuple[float, float]):
    np.testing.assert_allclose(color_of_grey(*photo(), *corner), [0.5, 0.4, 0.3])


@pytest.mark.parametrize(
    ("at", "words"),
    [
        ((5, 5), "black in some channel"),
        ((12, 5), "saturated"),
        ((20, 5), "transparent"),
        ((WIDTH, 5), "outside the photo of 30 x 20 pixels"),
        ((5, -0.1), "outside"),
    ],
)
def test_what_has_no_color_is_refused(at: tuple[float, float], words: str):
    color, usable, clipped = photo()
    color[3:8, 3:8, 2] = 0.005
    clipped[6, 13, 0] = True
    usable[7, 18] = False
    with pytest.raises(InputError, match=rf"{words}.*choose something grey that is neither"):
        color_of_grey(color, usable, clipped, *at)
