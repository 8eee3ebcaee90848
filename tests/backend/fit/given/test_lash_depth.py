"""How dark the line of the lashes is in a photo, against pictures drawn with one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.landmarks import Landmarks
from facestage.fit.given.lash_depth import DARKEST, SHADE, lash_depth
from facestage.models.anatomy.landmark_schemes import scheme_of

SIZE = 200


def eyes(width: float = 60.0) -> Landmarks:
    """Two level eyes, open by a quarter of their ``width`` in pixels."""
    points = np.full((478, 2), 5.0)
    for eye, left in zip(scheme_of("mediapipe478").eyes, (30.0, 110.0), strict=True):
        points[list(eye.corners)] = [[left, 100.0], [left + width, 100.0]]
        for n, (upper, lower) in enumerate(eye.lids, 1):
            x = left + width * n / (len(eye.lids) + 1)
            points[upper], points[lower] = (x, 100 - width / 8), (x, 100 + width / 8)
    return Landmarks("mediapipe478", points, np.ones(478, bool))


def picture(darker: float, width: float = 60.0) -> np.ndarray:
    """Skin with a line over all of its breadth, on the upper lids' border, ``darker`` by so much of
    the logarithm.
    """
    color = np.full((SIZE, SIZE, 3), [0.5, 0.35, 0.28])
    border = round(100 - width / 8)
    color[border - max(1, round(width / 20)) : border] *= np.exp(-darker)
    return color


@pytest.mark.parametrize(("darker", "expected"), [(0.0, 0.0), (0.2, 0.0), (0.9, 0.65)])
def test_the_line_is_as_dark_as_the_photo_has_it(darker: float, expected: float):
    assert pytest.approx(expected, abs=0.05) == lash_depth(picture(darker), eyes())
    assert lash_depth(4.0 * picture(darker), eyes()) == pytest.approx(
        lash_depth(picture(darker), eyes()), abs=1e-6
    )


def test_no_line_is_darker_than_lashes_are():
    assert lash_depth(picture(5.0), eyes()) == DARKEST
    assert SHADE > 0


def test_nothing_is_said_of_eyes_that_are_small_or_hidden():
    assert lash_depth(picture(3.0, 14.0), eyes(14.0)) > 0.3
    assert lash_depth(picture(3.0, 8.0), eyes(8.0)) == 0.0
    hidden = eyes()
    assert lash_depth(picture(0.9), replace(hidden, visible=np.zeros(478, bool))) == 0.0
    assert lash_depth(np.zeros((SIZE, SIZE, 3)), eyes()) == 0.0
