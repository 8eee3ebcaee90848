"""How far a piece of a picture is displaced: noise of known shifts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from facestage.fit.stereo.correlation import (
    BANDS,
    Band,
    Displacements,
    detail,
    displacements,
    surest,
    textured,
)

SIZE, REACH, BORDER = 72, 5, 16
SEEN = np.ones((SIZE, SIZE), bool)
FINE, COARSE = BANDS
INNER = np.s_[BORDER:-BORDER, BORDER:-BORDER]


def texture(seed: int = 1) -> np.ndarray:
    """Of contrast 0.1, with detail of about two pixels."""
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(SIZE, SIZE)), 0.9)
    return np.asarray(0.1 * noise / noise.std())


def compared(
    first: np.ndarray,
    second: np.ndarray,
    seen: np.ndarray = SEEN,
    reach: int = REACH,
    band: Band = FINE,
) -> Displacements:
    details = [detail(one, seen, band) for one in (first, second)]
    return displacements(details[0], details[1], seen, reach, band)


@pytest.mark.parametrize("spacing", [1, 3, 4])
def test_a_lattice_knows_what_every_pixel_does(spacing: int):
    first = texture()
    second = shift(first, (1.3, -0.6), order=5, mode="mirror")
    details = [detail(one, SEEN, FINE) for one in (first, second)]
    every = displacements(details[0], details[1], SEEN, REACH, FINE)
    some = displacements(details[0], details[1], SEEN, REACH, FINE, spacing)
    first_row = range(SIZE)[spacing // 2 :: spacing]
    assert some.sure.shape == (len(first_row), len(first_row))
    for name in ("shift", "sure", "information"):
        there = getattr(every, name)[np.ix_(first_row, first_row)]
        np.testing.assert_array_equal(getattr(some, name), there)


def light(strength: float) -> np.ndarray:
    y, x = np.mgrid[:SIZE, :SIZE] / SIZE
    return np.asarray(strength * np.sin(3 * x + y))


@pytest.mark.parametrize("band", BANDS, ids=["fine", "coarse"])
@pytest.mark.parametrize("true", [(0.0, 0.0), (0.37, -2.4), (-3.6, 1.5)])
def test_a_known_shift_is_found_in_any_light(true: tuple[float, float], band: Band):
    first = texture()
    # scipy shifts rows first; the content of the first is found at + shift in the second.
    second = shift(first, true[::-1], order=5, mode="mirror")
    moved = compared(first + light(0.5), 0.6 * second + light(-0.8), band=band)
    found, sure = moved.shift[INNER], moved.sure[INNER]
    off = np.linalg.norm(found[sure] - true, axis=-1)
    print(f"{sure.mean():.0%} sure, median {np.median(off):.3f} pixels off")
    assert sure.mean() > 0.9
    assert np.median(off) < 0.08 and (off > 0.5).mean() < 0.02


def test_skin_without_texture_says_nothing():
    random = np.random.default_rng(2)
    first, second = (light(s) + 0.003 * random.normal(size=(SIZE, SIZE)) for s in (0.5, 0.4))
    for band in BANDS:
        assert compared(first, second, band=band).sure.mean() < 0.05
        assert not textured(detail(first, SEEN, band), SEEN, band)[INNER].any()
        assert textured(detail(texture(), SEEN, band), SEEN, band).all()


def test_different_skins_have_no_peak():
    moved = compared(texture(1), texture(2))
    assert moved.sure.mean() < 0.05


def test_a_match_is_as_good_as_it_says():
    off = []
    for seed in range(4):
        random, first = np.random.default_rng(seed), texture(seed)
        noisy = [one + 0.06 * random.normal(size=one.shape) for one in (first, first)]
        moved = compared(noisy[0], noisy[1])
        sure = moved.sure[INNER]
        shifts, information = moved.shift[INNER][sure], moved.information[INNER][sure]
        off.append(np.einsum("px,pxy,py->p", shifts, information, shifts))
    squared = float(np.median(np.concatenate(off)))
    print(f"median squared deviations: {squared:.2f}, of a Gaussian in two directions 1.39")
    # What differs between real photos is correlated, and white noise is not: better than it says.
    assert 0.1 < squared < 1.39


def test_lines_tell_across_alone():
    y, x = np.mgrid[:SIZE, :SIZE]
    lines = 0.1 * np.sin(2 * np.pi * x / 5.0 + 0.3 * np.sin(2 * np.pi * y / 24.0))
    moved = compared(lines, lines, reach=2)
    information = moved.information[INNER][moved.sure[INNER]]
    if len(information):
        assert np.median(information[:, 0, 0] / information[:, 1, 1]) > 10


def test_what_is_not_seen_does_not_count():
    first, second, seen = texture(1), texture(1), SEEN.copy()
    seen[:, SIZE // 2 :] = False
    second[:, SIZE // 2 :] = texture(3)[:, SIZE // 2 :]
    moved = compared(first, second, seen)
    left = np.s_[BORDER:-BORDER, BORDER : SIZE // 2 - 4]
    assert moved.sure[left].mean() > 0.9
    assert np.abs(moved.shift[left][moved.sure[left]]).max() < 0.05


def test_where_noise_hides_pores_moles_are_found():
    random = np.random.default_rng(4)
    moles = gaussian_filter(random.normal(size=(SIZE, SIZE)), 1.6)
    moles *= 0.1 / moles.std()
    noisy = [moles + 0.09 * random.normal(size=moles.shape) for _ in range(2)]
    fine, coarse = (compared(noisy[0], noisy[1], band=band) for band in BANDS)
    assert fine.sure[INNER].mean() < 0.5 < 0.8 < coarse.sure[INNER].mean()
    best = surest([fine, coarse])
    assert (best.sure == (fine.sure | coarse.sure)).all()
    off = np.linalg.norm(best.shift[best.sure], axis=-1)
    assert np.median(off) < 0.4
    # Of two that are sure the one that says it is better.
    both = fine.sure & coarse.sure
    better = np.linalg.det(fine.information) > np.linalg.det(coarse.information)
    np.testing.assert_array_equal(best.shift[both & better], fine.shift[both & better])
    np.testing.assert_array_equal(best.shift[both & ~better], coarse.shift[both & ~better])
