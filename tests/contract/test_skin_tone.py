"""Skin color in numbers, against colors whose CIELAB is known."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.contract.errors import InputError
from facestage.contract.skin_tone import (
    ANGLES,
    SKIN_TYPES,
    chromaticity,
    cielab,
    from_cielab,
    parse_skin_tone,
    skin_type,
    type_angle,
    typology_angle,
    usual_color,
)
from facestage.models.anatomy.skin import HAEMOGLOBIN_MEAN, skin_albedo

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


def test_a_type_s_angle_is_of_that_type() -> None:
    assert [skin_type(type_angle(name)) for name, _ in SKIN_TYPES] == [
        name for name, _ in SKIN_TYPES
    ]
    assert all(ANGLES[0] < type_angle(name) < ANGLES[1] for name, _ in SKIN_TYPES)


@pytest.mark.parametrize("angle", [-75.0, -40.0, 0.0, 30.0, 65.0])
def test_usual_colors_are_those_of_pigments(angle: float) -> None:
    melanin = np.geomspace(0.005, 0.45, 400)
    colors = skin_albedo(melanin, np.full_like(melanin, HAEMOGLOBIN_MEAN))
    nearest = colors[np.abs(typology_angle(colors) - angle).argmin()]
    np.testing.assert_allclose(usual_color(angle), nearest, rtol=0.1, atol=0.004)
    assert abs(typology_angle(np.array(usual_color(angle))) - angle) < 2


@pytest.mark.parametrize(
    ("text", "angle"),
    [("12.5", 12.5), ("-80", -80.0), ("Very-Light", 62.5), ("brown", -10.0), (" dark ", -55.0)],
)
def test_a_tone_is_a_type_or_an_angle(text: str, angle: float) -> None:
    assert parse_skin_tone(text) == angle


@pytest.mark.parametrize("text", ["pale", "", "90", "-81", "nan", "inf", "1e400"])
def test_what_is_no_tone_is_refused(text: str) -> None:
    with pytest.raises(InputError, match=r"-80 \(darkest\) to 70 degrees"):
        parse_skin_tone(text)


def test_chromaticity_is_a_share() -> None:
    np.testing.assert_allclose(
        chromaticity(np.array([[4.0, 3.0, 1.0], [0.0, 0.0, 0.0]])),
        [[0.5, 0.375, 0.125], [0.0, 0.0, 0.0]],
    )
