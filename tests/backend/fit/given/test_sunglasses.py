"""Sunglasses on drawn faces, and what hides as much of faces that wear none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from facestage.fit.given.skin_mask import paint_weight
from facestage.fit.given.sunglasses import sunglasses
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.drawn_glasses import (
    APART,
    BRIDGE,
    BROWS,
    EYES,
    LENS,
    MIDDLE,
    SIDE,
    SIZES,
    X,
    Y,
    drawn,
    landmarks,
)

DISCS = np.hypot(np.abs(X - MIDDLE) - APART, Y - EYES) < LENS + 2
# From the brows' middle to below the eyes, with a bar along the brows.
SQUARE = (np.abs(np.abs(X - MIDDLE) - APART) < LENS) & (Y > BROWS) & (Y < EYES + 40)
BAR = (np.abs(X - MIDDLE) < APART + LENS) & (np.abs(Y - BROWS - 5) < 7)
MIRRORED = np.hypot(X - MIDDLE - APART, Y - EYES - 26) < 6


def worn(*dark: np.ndarray) -> np.ndarray:
    """(h, w) 0..1, skin without what is ``dark``."""
    return drawn(*dark)[1]


@pytest.mark.parametrize("scheme", SIZES)
@pytest.mark.parametrize("glass", [DISCS | BRIDGE, SQUARE | BAR])
def test_dark_glass_is_found_with_its_rim_and_little_else(scheme: str, glass: np.ndarray):
    arm_and_hair = (X < MIDDLE - APART) & (np.abs(Y - BROWS - 10) < 3) | (X < 52)
    skin = np.where(MIRRORED, 1.0, worn(glass, arm_and_hair))
    found = sunglasses(skin, landmarks(scheme))
    assert found[binary_dilation(glass, iterations=2)].all()
    brows, near = worn() == 0, np.hypot(np.abs(X - MIDDLE) - APART, Y - EYES) < 90
    assert not found[~binary_dilation(glass | brows | (arm_and_hair & near), iterations=6)].any()


def test_the_upper_edge_of_dark_glass_is_not_painted_as_brows():
    marks = landmarks("ibug68")
    skin = worn(SQUARE | BAR)
    painted = paint_weight(skin, marks) > 0.5
    assert painted[BAR].any()
    assert not (painted & ~sunglasses(skin, marks))[BAR].any()


@pytest.mark.parametrize(
    "dark",
    [
        pytest.param((), id="bare"),
        pytest.param((DISCS & (X < MIDDLE), BRIDGE), id="a patch over one eye"),
        pytest.param((DISCS,), id="sockets in shadow, which the nose parts"),
        pytest.param((Y < EYES + 20,), id="a fringe down to the lids"),
        pytest.param(
            (np.abs(np.hypot(np.abs(X - MIDDLE) - APART, Y - EYES) - LENS) < 4, BRIDGE),
            id="a frame",
        ),
    ],
)
def test_a_face_without_sunglasses_has_none(dark: tuple[np.ndarray, ...]):
    assert not sunglasses(worn(*dark), landmarks("mediapipe478")).any()


def test_what_cannot_be_looked_at_has_none():
    skin, marks = worn(DISCS | BRIDGE), landmarks("ibug68")
    unknown = marks.points.copy()
    unknown[scheme_of("ibug68").openings[2]] = np.nan
    assert not sunglasses(skin, replace(marks, points=unknown)).any()
    assert not sunglasses(skin, replace(marks, points=marks.points - 2.0 * SIDE)).any()
    assert not sunglasses(skin[::10, ::10], replace(marks, points=marks.points / 10)).any()


def test_large_photographs_are_looked_at_smaller():
    skin, marks = worn(DISCS | BRIDGE), landmarks("ibug68")
    large = np.kron(skin, np.ones((4, 4)))
    found = sunglasses(large, replace(marks, points=4 * marks.points))
    assert found.shape == large.shape
    assert (found[2::4, 2::4] != sunglasses(skin, marks)).mean() < 0.01
