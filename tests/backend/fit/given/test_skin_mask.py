"""The skin mask against drawn faces: shading, highlights, noise, hair, glasses and colored walls of
known places.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.path import Path as Outline
from scipy.ndimage import binary_dilation, binary_erosion

from facestage.contract.landmarks import SCHEME_SIZES, Landmarks
from facestage.fit.given.face_areas import (
    brow_pixels,
    face_pixels,
    face_size_px,
    lips_share,
    opening_share,
)
from facestage.fit.given.skin_mask import MASK_FACE_PX, clear_of_others, paint_weight, skin_weight
from facestage.models.anatomy.landmark_schemes import scheme_of
from reference.drawn_face import SKIN, DrawnFace

FACE = DrawnFace(1)
Y, X = FACE.grid
SIZE = len(X)
draw = FACE.draw


@pytest.fixture(scope="module")
def landmarks() -> Landmarks:
    return FACE.landmarks


def overlap(weight: np.ndarray, skin: np.ndarray, region: np.ndarray) -> float:
    """Intersection over union of the mask and the truth within a region."""
    mask = weight > 0.5
    return float((mask & skin & region).sum() / ((mask | skin) & region).sum())


def between_lips_and_lids(landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, pixels that an opening of mouth or eyes touches."""
    centres = np.stack([X.ravel(), Y.ravel()], axis=1)
    rings = (landmarks.points[60:68], landmarks.points[36:42], landmarks.points[42:48])
    inside = [Outline(np.vstack([ring, ring[:1]])).contains_points(centres) for ring in rings]
    return binary_dilation(np.any(inside, axis=0).reshape(SIZE, SIZE), np.ones((3, 3)))


EVERYWHERE = np.ones((SIZE, SIZE), bool)


@pytest.mark.parametrize("skin", SKIN)
def test_a_bare_face_is_skin_and_the_wall_is_not(landmarks: Landmarks, skin: str):
    photo, inside = draw(skin)
    weight = skin_weight(photo, landmarks)
    assert weight.dtype == np.float32 and weight.min() >= 0 and weight.max() <= 1
    # What the lamp does not reach is as dark as hair; the rest is all there.
    lit = photo.mean(axis=2) > 0.25 * photo[inside].mean()
    assert overlap(weight, inside & lit, (~inside | lit) & ~between_lips_and_lids(landmarks)) > 0.97


@pytest.mark.parametrize("skin", SKIN)
def test_highlights_are_skin(landmarks: Landmarks, skin: str):
    photo, inside = draw(skin)
    spot = np.zeros((SIZE, SIZE))
    for x, y in ((100, 92), (68, 58), (84, 84)):
        spot += np.exp(-((X - x) ** 2 + (Y - y) ** 2) / 30)
    photo += np.where(inside, 0.3 * spot, 0)[..., None]
    shiny = inside & (spot > 0.2)
    assert skin_weight(photo, landmarks)[shiny].mean() > 0.97


@pytest.mark.parametrize("face_px", [MASK_FACE_PX, 45.0])
def test_hair_over_the_forehead_is_not_skin(landmarks: Landmarks, face_px: float):
    photo, inside = draw("light")
    hair = (Y - 6 * np.sin(X / 4) < 62) & ((X - 80) ** 2 + (Y - 66) ** 2 < 58**2)
    strands = 0.6 + 0.4 * np.sin(1.9 * X + 0.3 * np.sin(Y / 5))
    photo = np.where(hair[..., None], strands[..., None] * [0.07, 0.045, 0.03], photo)
    weight = skin_weight(photo, landmarks, face_px=face_px)
    # Colors are looked at in a smaller picture, where the face would be larger.
    assert (weight == skin_weight(photo, landmarks)).all() == (face_px == MASK_FACE_PX)
    assert weight[hair].mean() < 0.1
    lit = photo.mean(axis=2) > 0.2
    assert weight[inside & ~hair & lit & ~between_lips_and_lids(landmarks)].mean() > 0.95


def test_teeth_are_not_skin_though_they_are_bright(landmarks: Landmarks):
    photo, inside = draw("light", light=(0.2, 0.2, 0.96))
    points = landmarks.points.copy()
    points[64:68, 1] += 12.0
    laughing = Landmarks("ibug68", points, landmarks.visible)
    opening = between_lips_and_lids(laughing)
    mouth = opening & (Y > 85)
    photo[mouth] = 1.5 * photo[inside].mean() * np.array([1.0, 0.96, 0.9])
    weight = skin_weight(photo, laughing)
    assert weight[binary_erosion(mouth, np.ones((5, 5)))].max() == 0.0
    assert (
        weight[binary_dilation(mouth, iterations=6) & ~binary_dilation(mouth, iterations=2)].min()
        > 0.9
    )


def test_the_share_of_an_opening_is_its_area(landmarks: Landmarks):
    points = landmarks.points.copy()
    points[60:68] = [
        [70.3, 100],
        [75, 100],
        [80, 100],
        [85, 100],
        [90.3, 100],
        [85, 110.6],
        [80, 110.6],
        [75, 110.6],
    ]
    points[36:48] = np.nan
    share = opening_share((SIZE, SIZE), Landmarks("ibug68", points, np.ones(68, bool)))
    # A border has the width of a pixel: half of it outside.
    assert 0.0 <= share.sum() - 0.5 * (20 + 10) * 10.6 < 40
    assert share[105, 79] == 1.0 and share[:98].max() == 0.0 and share[:, :68].max() == 0.0


@pytest.mark.parametrize("scheme", SCHEME_SIZES)
def test_lips_lie_around_what_is_between_them(scheme: str):
    known, points = scheme_of(scheme), np.full((SCHEME_SIZES[scheme], 2), np.nan)
    for ring, radius in ((known.lips, 20.0), (known.openings[0], 9.0)):
        angle = np.linspace(0, 2 * np.pi, len(ring), endpoint=False)
        points[ring] = 80 + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    share = lips_share((SIZE, SIZE), Landmarks(scheme, points, np.isfinite(points).all(axis=1)))
    rows, columns = np.indices(share.shape) + 0.5
    apart = np.hypot(rows - 80, columns - 80)
    assert share[(apart > 11) & (apart < 17)].min() == 1.0
    assert share[apart < 7].max() == 0.0 and share[apart > 22].max() == 0.0


def test_nobody_knows_lips_of_which_a_point_is_missing(landmarks: Landmarks):
    points = landmarks.points.copy()
    points[50] = np.nan
    assert not lips_share((SIZE, SIZE), replace(landmarks, points=points)).any()


def test_noise_leaves_no_holes(landmarks: Landmarks):
    photo, inside = draw("light")
    random = np.random.default_rng(0)
    noisy = np.maximum(photo + 0.09 * np.sqrt(photo) * random.normal(size=photo.shape), 0)
    lit = photo.mean(axis=2) > 0.15
    assert skin_weight(noisy, landmarks)[inside & lit].mean() > 0.95


def test_a_wall_of_another_color_is_not_skin(landmarks: Landmarks):
    photo, inside = draw("light", light=(0.2, 0.2, 0.96))
    for color in ([0.05, 0.6, 0.12], [0.9, 0.9, 0.9], [0.1, 0.2, 0.7]):
        photo[~inside] = color
        assert (skin_weight(photo, landmarks)[~inside] > 0.5).mean() < 0.05


def test_sunglasses_are_not_skin(landmarks: Landmarks):
    photo, _ = draw("light")
    glass = (np.abs(Y - 70) < 12) & (np.abs(X - 80) < 34) & (np.abs(X - 80) > 3)
    photo[glass] = [0.02, 0.02, 0.022]
    assert skin_weight(photo, landmarks)[glass].mean() < 0.1


def test_a_frame_of_glasses_is_not_skin(landmarks: Landmarks):
    photo, _ = draw("light")
    frame = np.zeros((SIZE, SIZE), bool)
    for x in (62, 98):
        frame |= np.abs(np.hypot(X - x, 1.2 * (Y - 68)) - 14) < 1.3
    photo[frame] = 0.02
    weight = skin_weight(photo, landmarks)
    assert weight[frame].mean() < 0.15


def test_pixels_without_light_and_faces_at_the_border_give_numbers(landmarks: Landmarks):
    assert np.isfinite(skin_weight(np.zeros((SIZE, SIZE, 3)), landmarks)).all()
    photo, _ = draw("light")
    moved = Landmarks("ibug68", landmarks.points + 60.0, landmarks.visible)
    assert np.isfinite(skin_weight(photo, moved)).all()
    assert np.isfinite(
        skin_weight(photo[:12, :9], Landmarks("ibug68", landmarks.points / 18, landmarks.visible))
    ).all()


def test_the_same_photo_gives_the_same_mask(landmarks: Landmarks):
    photo, _ = draw("dark")
    np.testing.assert_array_equal(
        skin_weight(photo, landmarks), skin_weight(photo.copy(), landmarks)
    )


def test_brows_are_painted_and_hair_that_hangs_over_them_is_not(landmarks: Landmarks):
    photo, inside = draw("light", light=(0.2, 0.2, 0.96))
    brows = np.zeros((SIZE, SIZE), bool)
    for start in (17, 22):
        for x, y in landmarks.points[start : start + 5]:
            brows |= np.hypot(X - x, Y - y - 2) < 2.5
    lock = (np.abs(X - 96) < 5) & (Y < 90) & (Y > 20)
    photo = np.where((brows | lock)[..., None], [0.05, 0.03, 0.02], photo)
    weight = paint_weight(skin_weight(photo, landmarks), landmarks)
    hull = face_pixels((SIZE, SIZE), landmarks)
    assert weight[brows & hull & (X < 80)].min() == 1.0
    assert weight[lock].mean() < 0.1
    assert weight[inside & hull & ~lock & (X < 88)].min() == 1.0


def test_a_brow_whose_end_meets_the_hair_is_painted(landmarks: Landmarks):
    """As in a face that is turned: what is left out is the hair alone."""
    photo, _ = draw("light", light=(0.2, 0.2, 0.96))
    brow = np.zeros((SIZE, SIZE), bool)
    for one, two in pairwise(landmarks.points[22:27]):
        for share in np.linspace(0, 1, 10):
            x, y = one + share * (two - one)
            brow |= np.hypot(X - x, Y - y) < 2.5
    hair = landmarks.points[26, 0] + 3 < X
    photo = np.where((brow | hair)[..., None], [0.05, 0.03, 0.02], photo)
    weight = paint_weight(skin_weight(photo, landmarks), landmarks)
    assert weight[brow & ~hair].min() == 1.0
    assert weight[hair & ~brow_pixels((SIZE, SIZE), landmarks)].mean() < 0.05


def test_the_upper_half_of_a_brow_is_painted_too(landmarks: Landmarks):
    photo, _ = draw("light", light=(0.2, 0.2, 0.96))
    brows = np.zeros((SIZE, SIZE), bool)
    for start in (17, 22):
        for x, y in landmarks.points[start : start + 5]:
            brows |= np.hypot(X - x, Y - y) < 3
    photo = np.where(brows[..., None], [0.05, 0.03, 0.02], photo)
    weight = paint_weight(skin_weight(photo, landmarks), landmarks)
    assert (brows & ~face_pixels((SIZE, SIZE), landmarks)).sum() > 50
    assert weight[brows].min() == 1.0


def test_brows_lie_around_their_landmarks_and_nowhere_else(landmarks: Landmarks):
    found = brow_pixels((SIZE, SIZE), landmarks)
    away = np.full((SIZE, SIZE), np.inf)
    for start in (17, 22):
        for one, two in pairwise(landmarks.points[start : start + 5]):
            for share in np.linspace(0, 1, 20):
                x, y = one + share * (two - one)
                away = np.minimum(away, np.hypot(X - x, Y - y))
    reach = round(0.04 * face_size_px(landmarks))
    assert found[away < reach - 1].all()
    assert not found[away > reach + 2].any()


def test_skin_beside_hair_is_not_clear_of_it():
    x = np.arange(200)[None].repeat(80, axis=0)
    paint, face = (x >= 50).astype(float), np.ones((80, 200), bool)
    # 2.5 % of 200 pixels: nothing counts up to 5 pixels from the hair, all from 10 pixels on.
    clear = clear_of_others(paint, face, 200.0)
    np.testing.assert_array_equal(clear[:, :55], 0.0)
    np.testing.assert_array_equal(clear[:, 60:], 1.0)
    np.testing.assert_allclose(clear[40, 54:60], np.arange(6) / 5, atol=0.25)


def test_only_what_hides_the_face_has_a_border():
    x = np.arange(200)[None].repeat(80, axis=0)
    wall = clear_of_others((x >= 50).astype(float), x >= 50, 200.0)
    speck = np.ones((80, 200))
    speck[40:49, 100:109] = 0.0
    np.testing.assert_array_equal(wall, 1.0)
    np.testing.assert_array_equal(clear_of_others(speck, x >= 0, 200.0), 1.0)
    speck[40:52, 100:112] = 0.0
    assert clear_of_others(speck, x >= 0, 200.0)[45, 114] == 0.0
