"""The smooth part of what is darker in a shadow is lifted; what is narrower is skin's own."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.textures.cast_shadow import DARKER, DARKEST, shadow_depth

FACE, SIDE = 160.0, 200
LEFT = np.arange(SIDE) < 80
SHADOW = np.tile(LEFT, (SIDE, 1))
DEPTH = 0.8


def plate(step: int = 1) -> np.ndarray:
    """(P, 2) centres of pixels that are looked at."""
    y, x = np.mgrid[:SIDE:step, :SIDE:step] + 0.5
    return np.stack([x.ravel(), y.ravel()], axis=1)


def in_shadow(pixels: np.ndarray, depth: float = DEPTH) -> np.ndarray:
    """(P,) the residual of a face whose left side lies in a shadow."""
    return np.where(LEFT[pixels[:, 0].astype(int)], -depth, 0.0)


def lifted(
    pixels: np.ndarray, residual: np.ndarray, weight: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    weight = np.ones(len(pixels)) if weight is None else weight
    return shadow_depth(pixels, residual, weight, SHADOW, FACE, 2.0)


@pytest.mark.parametrize("exposure", [-0.5, 0.0, 0.7])
@pytest.mark.parametrize("step", [1, 2])
def test_a_shadow_goes_and_what_is_narrow_in_it_stays(step: int, exposure: float):
    pixels = plate(step)
    mole = np.linalg.norm(pixels - [40, 100], axis=1) < 3
    found, there = lifted(pixels, exposure + in_shadow(pixels) - 0.5 * mole)
    assert found.shape == (SIDE, SIDE)
    np.testing.assert_allclose(found[:, :60], DEPTH - DARKER, atol=0.06)
    assert not found[:, 95:].any()
    inside = pixels[:, 0] < 60
    np.testing.assert_allclose(there[inside], DEPTH - DARKER, atol=0.06)


@pytest.mark.parametrize("sees", ["both sides", "one side"])
def test_a_brow_has_skin_on_both_sides(sees: str):
    """What is darkest at the edge of a cap's brim is the deepest of its shadow."""
    pixels = plate()
    x, y = pixels.T
    band = (np.abs(y - 100) < 6) & (np.abs(x - 40) < 25)
    known = np.ones(len(pixels)) if sees == "both sides" else 1.0 * (y > 94)
    _, there = lifted(pixels, np.where(band, -DEPTH - 0.6, in_shadow(pixels)), known)
    middle = (np.abs(pixels - [40, 100]) < [10, 3]).all(axis=1)
    print(f"{sees}: lifted by {there[middle].mean():.2f}")
    if sees == "both sides":
        assert there[middle].max() < DEPTH + 0.05
    else:
        assert there[middle].min() > DEPTH + 0.25


def test_what_is_light_or_shines_in_a_shadow_is_not_lifted():
    pixels = plate()
    shines = np.linalg.norm(pixels - [40, 100], axis=1) < 3
    found, there = lifted(pixels, np.where(shines, 0.5, in_shadow(pixels)))
    assert found[100, 40] > 0.4 and not there[shines].any()
    _, there = lifted(pixels, np.where(shines, -0.2, in_shadow(pixels)))
    assert 0.2 < there[shines].max() < 0.2 + 1.5 * DARKER


def test_eyes_are_lifted_as_the_skin_around_them_is():
    pixels = plate()
    eye = (np.abs(pixels - [40, 100]) < [10, 5]).all(axis=1)
    found, _ = lifted(pixels, np.where(eye, 3.0, in_shadow(pixels)), 1.0 - eye)
    np.testing.assert_allclose(found[96:104, 31:49], DEPTH - DARKER, atol=0.03)


def test_what_varies_as_skin_does_stays():
    pixels = plate()
    assert lifted(pixels, in_shadow(pixels, 0.5 * DARKER))[0].max() < 0.15 * DARKER
    assert not lifted(pixels, in_shadow(pixels, -0.5))[0].any()


def test_what_is_black_is_lifted_by_so_much_alone():
    pixels = plate()
    found, _ = lifted(pixels, in_shadow(pixels, 20.0))
    assert DARKEST - 2 * DARKER < found.max() < DARKEST


@pytest.mark.parametrize("seen", [LEFT, ~LEFT, LEFT & ~LEFT])
def test_without_skin_on_both_sides_nothing_is_lifted(seen: np.ndarray):
    pixels = plate()
    weight = 1.0 * seen[pixels[:, 0].astype(int)]
    for each in lifted(pixels, np.full(len(pixels), -1.0), weight):
        assert not each.any()
