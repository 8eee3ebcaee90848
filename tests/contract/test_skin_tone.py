"""Skin color in numbers, against colors whose CIELAB is known."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.skin_tone import (
    chromaticity,
    cielab,
    from_cielab,
    skin_type,
    typology_angle,
)

# Linear Rec. 709 and its CIELAB under D65 (Lindbloom's calculator).
KNOWN = {
    (1.0, 1.0, 1.0): (100.0, 0.0, 0.0),
    (1.0, 0.0, 0.0): (53.24, 80.09, 67.20),
    (0.0, 0.0, 1.0): (32.30, 79.19, -107.86),
    (0.1841865, 0.1841865, 0.1841865): (50.0, 0.0, 0.0),
    (0.001, 0.001, 0.001): (0.903, 0.0, 0.0),
}


@pytest.mark.parametrize(("color", "lab"), KNOWN.items())
def test_cielab_of_known_colors(
    color: tuple[float, float, float], lab: tuple[float, float, float]
) -> None:
    np.testing.assert_allclose(cielab(np.array(color)), lab, atol=0.02)
    np.testing.assert_allclose(from_cielab(np.array(lab)), color, atol=2e-4)


def test_the_angle_is_that_of_lightness_over_yellowness() -> None:
    colors = from_cielab(np.array([[60.0, 10.0, 15.0], [35.0, 10.0, 15.0], [50.0, 10.0, 15.0]]))
    np.testing.assert_allclose(typology_angle(colors), [33.690, -45.0, 0.0], atol=1e-3)
    assert [skin_type(angle) for angle in (56, 55, 41, 28, 10, -30, -90)] == [
        "very light",
        "light",
        "intermediate",
        "tan",
        "brown",
        "dark",
        "dark",
    ]


def test_chromaticity_is_a_share() -> None:
    np.testing.assert_allclose(
        chromaticity(np.array([[4.0, 3.0, 1.0], [0.0, 0.0, 0.0]])),
        [[0.5, 0.375, 0.125], [0.0, 0.0, 0.0]],
    )
