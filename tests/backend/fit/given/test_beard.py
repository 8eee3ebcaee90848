"""Hair below the nose is rough over more than a line; shadows, folds and spots are not."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from facestage.contract.landmarks import Landmarks
from facestage.fit.given.beard import beard_of
from facestage.fit.given.face_areas import above_brows, below_mouth, face_pixels
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.drawn_face import DrawnFace

FACE = DrawnFace(4)
LANDMARKS = FACE.landmarks
Y, X = FACE.grid
SHAPE = (X.shape[0], X.shape[1])
HEIGHT = above_brows(SHAPE, LANDMARKS)
CHIN = face_pixels(SHAPE, LANDMARKS) & (HEIGHT < -0.8) & (HEIGHT > -0.95) & (np.abs(X - 80) < 14)
BROW = face_pixels(SHAPE, LANDMARKS) & (HEIGHT > -0.3) & (np.abs(X - 80) < 14)


def strands(where: np.ndarray, depth: float = 1.2, share: float = 0.4) -> np.ndarray:
    """A face where a ``share`` of a place's pixels are darker by so much of the logarithm."""
    photo = FACE.draw("light", (0.2, 0.2, 0.96))[0]
    grain = np.random.default_rng(3).uniform(size=SHAPE) < share
    return photo * np.exp(-depth * (where & grain))[..., None]


def test_a_goatee_is_found_and_skin_beside_it_is_not():
    found = beard_of(strands(CHIN), LANDMARKS).share
    assert found[CHIN].mean() > 0.7
    assert not found[HEIGHT > -0.45].any() and found[~CHIN].mean() < 0.01


@pytest.mark.parametrize("where", ["shadow", "fold", "brow", "nothing"])
def test_what_is_smooth_or_thin_or_above_the_mouth_is_none(where: str):
    shade = np.exp(-1.2 * gaussian_filter(1.0 * CHIN, 8.0))[..., None]
    photo = {
        "shadow": shade * strands(CHIN & False),
        "fold": strands(CHIN & (np.abs(X - 80) < 1)),
        "brow": strands(BROW),
        "nothing": strands(CHIN & False),
    }[where]
    assert beard_of(photo, LANDMARKS).share[np.abs(X - 80) < 10].mean() < 0.01


def test_it_is_the_same_at_another_size_and_exposure():
    photo = strands(CHIN)
    found = beard_of(photo, LANDMARKS).share
    np.testing.assert_allclose(beard_of(3.0 * photo, LANDMARKS).share, found, atol=1e-6)
    large = np.repeat(np.repeat(photo, 2, axis=0), 2, axis=1)
    twice = beard_of(large, replace(LANDMARKS, points=2 * LANDMARKS.points)).share
    assert twice.shape == large.shape[:2]
    np.testing.assert_allclose(twice[::2, ::2].mean(), found.mean(), rtol=0.2)


def test_without_strands_to_see_there_is_none():
    small = strands(CHIN)[::4, ::4]
    assert not beard_of(small, replace(LANDMARKS, points=LANDMARKS.points / 4)).share.any()
    nowhere = Landmarks(LANDMARKS.scheme, np.full_like(LANDMARKS.points, np.nan), LANDMARKS.visible)
    assert not beard_of(strands(CHIN), nowhere).share.any()
    cheeks = LANDMARKS.points.copy()
    cheeks[scheme_of(LANDMARKS.scheme).skin] = np.nan  # unknown
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        known = np.isfinite(cheeks).all(axis=1)
        unknown = beard_of(strands(CHIN), Landmarks(LANDMARKS.scheme, cheeks, known))
    assert not (unknown.share.any() or unknown.covers.any())
    black = beard_of(np.zeros((*SHAPE, 3)), LANDMARKS)
    assert not (black.share.any() or black.covers.any())


def covered(photo: np.ndarray) -> np.ndarray:
    return beard_of(photo, LANDMARKS).covers


def test_a_black_goatee_covers_the_skin():
    found = covered(strands(CHIN, 2.5, 0.7))
    assert found[CHIN].mean() > 0.7 and found[~CHIN].mean() < 0.01


@pytest.mark.parametrize(
    ("where", "depth"),
    [
        (CHIN, 0.5),  # stubble
        (CHIN & (np.abs(X - 80) < 3), 2.5),  # the lower lip's shadow
        (face_pixels(SHAPE, LANDMARKS) & (np.abs(X - 54) < 9) & (HEIGHT < -0.5), 2.5),  # a cheek
        (CHIN & False, 0.0),
    ],
)
def test_nothing_else_does(where: np.ndarray, depth: float):
    assert not covered(strands(where, depth, 0.7)).any()


def test_between_mouth_and_chin_lies_neither_of_the_cheeks():
    inside = below_mouth(SHAPE, LANDMARKS)
    assert inside[CHIN].mean() > 0.9
    assert not inside[(np.abs(X - 80) > 30) | (HEIGHT > -0.45) | (HEIGHT < -1.1)].any()
    nobody = replace(LANDMARKS, points=np.full_like(LANDMARKS.points, np.nan))
    assert not below_mouth(SHAPE, nobody).any()


def test_a_rough_cheek_is_no_beard_unless_it_goes_on_around_the_mouth():
    """Strands of the head's own hair hang before cheeks, too."""
    below = face_pixels(SHAPE, LANDMARKS) & (HEIGHT < -0.5)
    side = below & (np.abs(X - 80) > 27)
    assert side.sum() > 500 and not beard_of(strands(side), LANDMARKS).share.any()
    whole = beard_of(strands(below), LANDMARKS).share
    assert whole[side].mean() > 0.4
