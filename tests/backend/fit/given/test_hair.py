"""Hair, hats and bald heads on drawn faces, whose colors are the skin's own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, binary_erosion, rotate

from facestage.contract.landmarks import Landmarks
from facestage.fit.given.face_areas import face_size_px
from facestage.fit.given.hair import FACE_MIN, hair_pixels
from facestage.fit.given.skin_mask import skin_weight
from reference.drawn_face import SKIN, DrawnFace

FACE = DrawnFace(2)
Y, X = FACE.grid
LANDMARKS = FACE.landmarks
FRONT = (0.2, 0.2, 0.96)
# A head of hair: from the crown down both sides of the face, and its line on the forehead.
HAIR = ((X - 80) ** 2 + (Y - 66) ** 2 < 62**2) & ((Y < 40) | (np.abs(X - 80) > 41)) & (Y < 110)
# What of the face looks at the camera.
FRONTAL = ((X - 80) / 46) ** 2 + ((Y - 78) / 60) ** 2 < 0.7
HAIR_INNER = binary_erosion(HAIR, iterations=6)


def with_hair(color: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A face with hair of ``color``, streaked by strands, and where its bare skin is."""
    photo, inside = FACE.draw("light", FRONT)
    strands = 0.55 + 0.3 * np.sin(3.1 * X + 2 * np.sin(Y / 6)) * np.sin(0.9 * X - Y / 9)
    photo = np.where(HAIR[..., None], strands[..., None] * color, photo)
    return photo, inside & ~HAIR


def looks(photo: np.ndarray) -> np.ndarray:
    """What the mask hands over, for a face whose median is the skin's color."""
    red, green, blue = np.moveaxis(np.maximum(photo, 1e-3), -1, 0)
    luminance = 0.2126 * red + 0.7152 * green + 0.0722 * blue
    result = np.log(np.stack([red / green, blue / green, luminance], axis=-1))
    return (result - np.median(result[150:190, 120:200], axis=(0, 1))).astype(np.float32)


@pytest.mark.parametrize("brightness", [0.6, 0.9, 1.3])
def test_hair_of_the_skins_own_hue_is_left_out(brightness: float):
    photo, skin = with_hair(brightness * np.array(SKIN["light"]))
    found = hair_pixels(looks(photo), LANDMARKS)
    assert found[HAIR_INNER].mean() > 0.97
    assert found[skin & FRONTAL].mean() < 0.03
    weight = skin_weight(photo, LANDMARKS)
    assert weight[HAIR_INNER].mean() < 0.03


def test_the_line_of_hair_is_where_it_is_drawn():
    photo, _ = with_hair(0.9 * np.array(SKIN["light"]))
    found = hair_pixels(looks(photo), LANDMARKS)
    column = found[:120, 140:180]
    line = len(column) - np.argmax(column[::-1], axis=0)
    # Within 1.5 % of the face.
    assert np.abs(np.median(line) - 80) < 4


def test_a_white_hat_is_left_out_and_a_highlight_is_not():
    photo, inside = FACE.draw("dark", FRONT)
    hat = (Y < 42) & ((X - 80) ** 2 + (Y - 66) ** 2 < 62**2)
    photo = np.where(hat[..., None], 0.3 + 0.1 * np.sin(X)[..., None], photo)
    shine = 0.2 * np.exp(-((X - 92) ** 2 + (Y - 52) ** 2) / 20)
    photo += np.where(inside & ~hat, shine, 0.0)[..., None]
    found = hair_pixels(looks(photo), LANDMARKS)
    assert found[binary_erosion(hat, iterations=6)].mean() > 0.97
    assert not found[(shine > 0.05) & ~hat].any()


@pytest.mark.parametrize("skin", SKIN)
def test_a_bald_head_is_skin_up_to_its_crown(skin: str):
    """No hairline is seen where hair usually begins, so there is none."""
    photo, inside = FACE.draw(skin, FRONT, crown=1.25)
    found = hair_pixels(looks(photo), LANDMARKS)
    head = ((X - 80) / 46) ** 2 + ((Y - 78) / 75) ** 2 < 0.6
    assert not found[head & (Y < 78)].any()
    wall = ~inside & (np.abs(X - 80) < 55) & (Y < 60)
    assert found[wall].mean() > 0.9


def test_ears_are_not_what_surroundings_are_learnt_from():
    """A cheek that turns away looks as they do."""
    photo, inside = FACE.draw("dark", crown=1.25)
    ears = (((np.abs(X - 80) - 46) / 10) ** 2 + ((Y - 84) / 22) ** 2 < 1) & ~inside
    beside = np.where((X > 80)[..., None], np.roll(photo, 60, axis=1), np.roll(photo, -60, axis=1))
    found = hair_pixels(looks(np.where(ears[..., None], beside, photo)), LANDMARKS)
    cheeks = (((X - 80) / 46) ** 2 + ((Y - 78) / 60) ** 2 < 0.9) & (Y > 70) & (Y < 105)
    assert found[cheeks].mean() < 0.02


def test_what_does_not_reach_the_face_from_outside_is_not_its_matter():
    """A patch of hair's look amid the chin: a beard's."""
    photo, _ = with_hair(0.6 * np.array(SKIN["light"]))
    patch = (np.abs(X - 80) < 9) & (np.abs(Y - 118) < 6)
    photo[patch] = np.roll(photo, 2 * 90, axis=0)[patch]
    assert not hair_pixels(looks(photo), LANDMARKS)[patch].any()


def test_a_face_before_a_wall_of_its_own_look_is_told_by_its_place():
    random = np.random.default_rng(0)
    photo = np.array(SKIN["light"]) * np.exp(0.05 * random.normal(size=(*X.shape, 1)))
    found = hair_pixels(looks(photo), LANDMARKS)
    assert found[FRONTAL & (Y > 50)].mean() < 0.01
    assert found[(np.abs(np.abs(X - 80) - 60) < 5) & (np.abs(Y - 80) < 30)].mean() > 0.9


def test_a_face_that_lies_on_its_side_is_read_the_same():
    photo, _ = with_hair(0.9 * np.array(SKIN["light"]))
    upright = hair_pixels(looks(photo), LANDMARKS)
    size = len(photo)
    turned = np.stack([LANDMARKS.points[:, 1], size - LANDMARKS.points[:, 0]], axis=1)
    lying = hair_pixels(
        np.ascontiguousarray(np.rot90(looks(photo))), replace(LANDMARKS, points=turned)
    )
    assert (np.rot90(lying, -1) != upright)[binary_dilation(HAIR_INNER)].mean() < 0.02
    tilted = rotate(looks(photo), 20, axes=(0, 1), reshape=False, order=1, mode="nearest")
    angle, middle = np.radians(20), size / 2
    way = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    points = (LANDMARKS.points - middle) @ way.T + middle
    found = rotate(
        hair_pixels(tilted, replace(LANDMARKS, points=points)).astype(float),
        -20,
        axes=(0, 1),
        reshape=False,
        order=1,
    )
    near = HAIR_INNER & (np.hypot(X - 80, Y - 80) < 70)
    assert found[near].mean() > 0.95


def test_a_face_of_few_pixels_shows_no_strands():
    photo, _ = with_hair(0.9 * np.array(SKIN["light"]))
    small = replace(LANDMARKS, points=LANDMARKS.points * 0.99 * FACE_MIN / face_size_px(LANDMARKS))
    assert not hair_pixels(looks(photo), small).any()


def test_no_surroundings_no_light_and_no_brows_hide_nothing():
    photo, _ = FACE.draw("light", FRONT)
    close = replace(LANDMARKS, points=LANDMARKS.points - [96.0, 110.0])
    assert not hair_pixels(looks(photo)[110:240, 96:224], close).any()
    assert not hair_pixels(np.zeros((320, 320, 3), np.float32), LANDMARKS)[200, 160]
    points = LANDMARKS.points.copy()
    points[17:27] = np.nan
    assert not hair_pixels(looks(photo), Landmarks("ibug68", points, LANDMARKS.visible)).any()


def test_the_same_photo_gives_the_same_hair():
    photo, _ = with_hair(0.9 * np.array(SKIN["light"]))
    np.testing.assert_array_equal(
        hair_pixels(looks(photo), LANDMARKS), hair_pixels(looks(photo).copy(), LANDMARKS)
    )
