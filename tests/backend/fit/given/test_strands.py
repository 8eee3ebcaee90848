"""Strands that hang into a face are found; scars, wrinkles and brows are not taken for any."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation, gaussian_filter

from facestage.fit.given.face_areas import above_brows, brow_pixels, chin_to_brows, opening_share
from facestage.fit.given.skin_mask import paint_weight, skin_weight
from facestage.fit.given.strands import strand_pixels
from reference.drawn_face import SKIN, DrawnFace

FACE = DrawnFace(2)
LANDMARKS = FACE.landmarks
Y, X = FACE.grid
SHAPE = (X.shape[0], X.shape[1])
FRONT = (0.2, 0.2, 0.96)
HAIR = ((Y < 40) & (np.hypot(X - 80, Y - 66) < 62)) | ~FACE.draw("light", FRONT)[1]
TEMPLES = np.abs(X - 80) > 36
# From the hair down the forehead, a pixel and a half wide.
STRAND = (np.abs(X - 66 - (Y - 40) / 4) < 0.75) & (Y >= 40) & (Y < 55)


def drawn(mark: np.ndarray, share: float, hair: np.ndarray = HAIR) -> np.ndarray:
    """A face under dark ``hair`` (h, w), ``share`` of whose light comes from ``mark`` (h, w)."""
    photo = FACE.draw("light", FRONT)[0]
    photo = np.where(hair[..., None], 0.03 * np.array(SKIN["light"]), photo)
    return np.where(mark[..., None], share * photo, photo)


def found(photo: np.ndarray, hair: np.ndarray = HAIR) -> np.ndarray:
    return strand_pixels(photo, np.where(hair, 0.0, 1.0), LANDMARKS)


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_a_strand_is_found_whole_and_no_skin_far_from_it(share: float):
    seen = found(drawn(STRAND, share))
    assert seen[STRAND].mean() > 0.95
    assert not seen[(np.abs(X - 66 - (Y - 40) / 4) > 4) | (Y > 58)].any()


def test_a_strand_is_not_painted_on_the_skin():
    photo = drawn(STRAND, 0.1)
    assert paint_weight(skin_weight(photo, LANDMARKS), LANDMARKS)[STRAND].mean() < 0.05


@pytest.mark.parametrize(
    ("mark", "share"),
    [
        (STRAND & (Y > 46), 0.1),  # a scar, which hangs from nothing
        (STRAND, 0.7),  # a wrinkle
        ((np.abs(X - 70) < 3) & (Y >= 40) & (Y < 52), 0.1),  # a birthmark
        (STRAND & False, 0.1),  # nothing at all
    ],
)
def test_what_is_no_strand_stays(mark: np.ndarray, share: float):
    assert not found(drawn(mark, share))[~HAIR & (X > 50) & (X < 110)].any()


def rough(where: np.ndarray) -> np.ndarray:
    """(h, w) factor on the light of skin that shines, or is wrinkled, ``where`` it is."""
    noise = gaussian_filter(np.random.default_rng(3).normal(size=SHAPE), 1.0)
    return np.exp(np.where(where, 0.35 * noise / noise.std(), 0.0))


def test_shining_skin_is_no_web_of_strands():
    """Between its highlights dark skin is darker than a strand is on a smooth forehead."""
    bare = ~HAIR & (np.abs(X - 80) < 30) & (Y > 42)
    photo = drawn(STRAND & False, 0.1) * rough(~HAIR)[..., None]
    share = found(photo)[bare].mean()
    print(f"{share:.1%} of the skin hang from hair")
    assert share < 0.02
    assert found(drawn(STRAND, 0.02) * rough(~HAIR)[..., None])[STRAND].mean() > 0.7


def test_a_beard_hides_no_strand_of_the_forehead():
    photo = drawn(STRAND, 0.5) * rough(~HAIR & (Y > 75))[..., None] ** 2
    assert found(photo)[STRAND].mean() > 0.9


def test_many_strands_are_no_rough_skin():
    strands = ((X - (Y - 40) / 4) % 3 < 1.5) & (Y >= 40) & (Y < 75)
    assert found(drawn(strands, 0.3))[strands & (Y < 50) & (np.abs(X - 80) < 18)].mean() > 0.85


def test_a_line_at_a_spot_amid_the_face_is_no_strand():
    """As a lash is at an eye, and a fold at a nostril."""
    spot = np.hypot(X - 80, Y - 62) < 3
    line = (np.abs(Y - 62) < 0.75) & (np.abs(X - 80) < 9)
    photo = drawn(spot | line, 0.1)
    assert not strand_pixels(photo, np.where(HAIR | spot, 0.0, 1.0), LANDMARKS).any()


def test_lines_over_brows_eyes_and_mouths_are_the_faces_own():
    """Drawn level, from the hair at the temple to the middle of the face."""
    up = above_brows(SHAPE, LANDMARKS)
    lids = binary_dilation(opening_share(SHAPE, LANDMARKS) > 0.5, iterations=4) & (up > -0.4)
    brows, lower = brow_pixels(SHAPE, LANDMARKS), up < -0.4
    for height, own in ((0.0, brows), (up[lids & (X < 80)].max() - 0.02, lids), (-0.5, lower)):
        line = (np.abs(up - height) < 0.008) & (X < 80) & ~TEMPLES
        assert (line & own).sum() > 10
        assert not found(drawn(line, 0.1, TEMPLES), TEMPLES)[line & own].any()


def test_large_photographs_are_looked_at_smaller():
    large = DrawnFace(8)
    rows, columns = large.grid
    strand = (np.abs(columns - 66 - (rows - 40) / 4) < 0.75) & (rows >= 40) & (rows < 55)
    hair = ((rows < 40) & (np.hypot(columns - 80, rows - 66) < 62)) | ~large.draw("light", FRONT)[1]
    photo = (
        large.draw("light", FRONT)[0] * np.where(hair, 0.03, np.where(strand, 0.1, 1))[..., None]
    )
    seen = strand_pixels(photo, np.where(hair, 0.0, 1.0), large.landmarks)
    assert seen.shape == strand.shape
    assert seen[strand].mean() > 0.95


def test_a_face_without_brows_and_one_all_hidden_have_none():
    photo = drawn(STRAND, 0.1)
    assert not strand_pixels(photo, np.zeros(HAIR.shape), LANDMARKS).any()
    points = LANDMARKS.points.copy()
    points[17:27] = np.nan
    unknown = replace(LANDMARKS, points=points)
    assert np.isnan(chin_to_brows(unknown)).all()
    assert not strand_pixels(photo, np.where(HAIR, 0.0, 1.0), unknown).any()
