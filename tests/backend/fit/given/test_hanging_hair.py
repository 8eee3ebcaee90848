"""Hair of the skin's hue before a cheek is what is far darker than the fit and goes on in what
hides the face; brows, beards, lids, moles and shades of its own are not.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_dilation

from facestage.fit.given.face_areas import face_size_px
from facestage.fit.given.hanging_hair import MAYBE, SURE, darker_than, hanging_hair
from reference.drawn_face import DrawnFace

FACE = DrawnFace(2)
LANDMARKS = FACE.landmarks
Y, X = FACE.grid
SHAPE = (X.shape[0], X.shape[1])
SEEN = FACE.draw("light")[1]
LENGTH = face_size_px(LANDMARKS) / 2  # of the face, in pixels at a scale of 1
# What colors tell of hair, and what hangs further in, before the left cheek.
HIDING = ~SEEN | (X < 45)
CHEEK = (X >= 45) & (X < 53) & (Y > 72) & (Y < 110) & SEEN


def found(
    darker: np.ndarray, hiding: np.ndarray = HIDING, beard: np.ndarray | None = None
) -> np.ndarray:
    none = np.zeros(SHAPE, bool)
    return hanging_hair(darker, SEEN & ~hiding, hiding, none if beard is None else beard, LANDMARKS)


def test_a_strip_beside_the_hair_is_hair_and_skin_is_not():
    hair = found(np.where(CHEEK, 0.9, 0.05))
    assert hair[CHEEK].all()
    # Its border mixes both.
    assert hair[binary_dilation(CHEEK) & SEEN].all()
    assert not hair[X > 53 + 0.05 * LENGTH].any()


def test_hair_ends_not_far_from_what_it_hangs_from():
    shade = (Y > 90) & (Y < 104) & (X >= 45) & (X < 90)
    hair = found(np.where(shade, 0.9, 0.0))
    assert hair[shade & (X < 45 + 0.13 * LENGTH)].all()
    assert not hair[X > 45 + 0.2 * LENGTH].any()


@pytest.mark.parametrize(
    "what",
    ["shade", "nothing near", "beside it", "mole", "beard", "full beard", "lids", "nothing hides"],
)
def test_what_else_is_dark_is_no_hair(what: str):
    darker, hiding, beard = np.where(CHEEK, 0.9, 0.0), HIDING, None
    if what == "shade":  # a cheek that the fit lights too well
        darker = np.where(CHEEK, 0.5, 0.0)
    elif what == "nothing near":
        hiding = ~SEEN & (Y < 40)
    elif what == "beside it":  # and skin between
        gap = 0.07 * LENGTH
        darker = np.where((45 + gap < X) & (50 + gap > X) & (Y > 80) & (Y < 100), 0.9, 0.0)
    elif what == "mole":
        darker = np.where(CHEEK & (Y > 90) & (Y < 92) & (X < 47), 0.9, 0.0)
    elif what == "beard":
        beard = CHEEK
    elif what == "full beard":  # of no strands, from one cheek to the other
        darker = np.where((Y > 85) & SEEN, 0.9, 0.0)
    elif what == "lids":
        eyes = LANDMARKS.points[36:48] / 2
        lids = np.min([np.hypot(X - x, Y - y) for x, y in eyes], axis=0) < 0.05 * LENGTH
        darker = np.where(lids, 0.9, 0.0)
        hiding = ~SEEN | (eyes[:, 1].min() - 0.06 * LENGTH > Y)
    else:
        hiding = np.zeros(SHAPE, bool)
    assert not found(darker, hiding, beard)[SEEN & ~hiding].any()


def test_a_face_that_nobody_sees_shows_none():
    none = np.zeros(SHAPE, bool)
    assert not hanging_hair(np.full(SHAPE, 0.9), none, HIDING, none, LANDMARKS).any()
    unknown = replace(LANDMARKS, points=np.full_like(LANDMARKS.points, np.nan))
    assert not hanging_hair(np.full(SHAPE, 0.9), SEEN, HIDING, none, unknown).any()


def test_it_is_the_same_at_another_size():
    small = DrawnFace(1)
    seen = small.draw("light")[1]
    hair = found(np.where(CHEEK, 0.9, 0.0))
    half = hanging_hair(
        np.where(CHEEK, 0.9, 0.0)[::2, ::2],
        seen & ~HIDING[::2, ::2],
        HIDING[::2, ::2],
        np.zeros(seen.shape, bool),
        small.landmarks,
    )
    assert half.sum() == pytest.approx(hair.sum() / 4, rel=0.15)


def test_where_the_fit_has_hardly_any_light_nothing_is_darker():
    """Half of next to nothing is no hair; a fifth of what skin sends back is."""
    rendered = np.outer([1.0] * 8 + [0.6, 0.03, 0.0], [1.2, 1.0, 0.8])
    photo = rendered * np.array([1.0] * 7 + [0.2, 0.2, 0.4, 1.0])[:, None]
    darker = darker_than(photo, rendered)
    np.testing.assert_allclose(darker[:7], 0.0, atol=1e-12)
    assert (darker[[7, 8]] > SURE).all() and darker[9] < MAYBE and darker[10] == 0
    np.testing.assert_allclose(darker_than(3 * photo, 3 * rendered), darker)
    assert (
        darker_than(-photo, rendered)[0] > 2
        and np.isfinite(darker_than(photo[:0], photo[:0])).all()
    )
