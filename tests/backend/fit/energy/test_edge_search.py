"""Where the photo shows an edge and where it does not: profiles made by hand."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.energy.edge_search import EdgeSearch
from facestage.fit.given.photo import Photo

SIDE, FACE_PX = 120, 100.0
FACE = np.array([0.5, 0.4, 0.3])


def strip(
    edge: float, back: np.ndarray = 0.1 * FACE, skin: float = 1.0, face: np.ndarray = FACE
) -> Photo:
    """The face left of x = ``edge``, to a part of a pixel."""
    coverage = np.clip(edge - np.arange(SIDE), 0, 1)
    color = coverage[:, None] * face + (1 - coverage[:, None]) * back
    picture = np.broadcast_to(color, (SIDE, SIDE, 3)).copy()
    everywhere = np.ones((SIDE, SIDE), bool)
    return Photo(picture, everywhere, np.full((SIDE, SIDE), skin), np.zeros(picture.shape, bool))


def offsets(photo: Photo, middle: list[float], face_px: float = FACE_PX) -> np.ndarray:
    """Of points at these x, in the picture's middle, looking right."""
    return EdgeSearch(photo, face_px).offset(*places(middle))


def nearest(photo: Photo, middle: list[float], further: bool = True) -> np.ndarray:
    """Likewise, further out where ``further`` says so."""
    points, normal = places(middle)
    return EdgeSearch(photo, FACE_PX).nearest(points, normal, np.full(len(points), further))


def places(middle: list[float], degrees: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Points at these x, in the picture's middle, and the way that they look, turned downwards."""
    points = np.stack([np.array(middle), np.full(len(middle), SIDE / 2)], axis=1)
    turned = [np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]
    return points, np.broadcast_to(turned, points.shape)


@pytest.mark.parametrize("edge", [60.0, 60.3, 60.5, 60.9])
def test_the_edge_is_found_to_a_part_of_a_pixel(edge: float):
    for middle in (59.75, 60.0, 61.0):
        assert offsets(strip(edge), [middle])[0] == pytest.approx(edge - middle, abs=0.06)


def test_the_edge_is_looked_for_within_a_fortieth_of_the_face():
    # 2.5 pixels of a face of 100; five of one of 200.
    found = offsets(strip(60.0), [54.5, 65.5, 56.5])
    assert np.isnan(found[:2]).all() and not found[2] > 2.75
    found = offsets(strip(60.0), [56.5, 63.5], 200.0)
    np.testing.assert_allclose(found, [3.5, -3.5], atol=0.06)
    # At least two pixels, however small the face.
    assert np.isfinite(offsets(strip(60.0), [58.5, 61.5], 10.0)).all()


def test_face_and_background_must_differ_by_a_third_of_the_brighter():
    """|face - back| over the brighter of them plus a tenth of the photo's mean; which is the
    brighter is one.
    """
    # of the face's norm, for a photo of the face's mean
    half = 0.1 * FACE.mean() / np.linalg.norm(FACE)
    for share, seen in ((0.60, True), (0.66, False)):
        photo = strip(60.0, share * FACE)
        contrast = (1 - share) / (1 + half * (1 + share) / 2)
        assert (contrast > 0.35) == seen
        assert np.isfinite(offsets(photo, [60.0]))[0] == seen
        assert np.isfinite(offsets(strip(60.0, FACE, face=share * FACE), [60.0]))[0] == seen


def test_the_contrast_of_a_dark_face_is_doubtful():
    """A tenth of the photo's mean is added to what the difference is compared with."""
    for bright, seen in ((0.0, True), (8.0, True), (20.0, False)):
        photo = strip(60.0, 0.5 * FACE)
        photo.color[:20] = bright if bright else 0.5 * FACE
        assert np.isfinite(offsets(photo, [60.0]))[0] == seen


def test_only_the_face_s_own_color_has_an_outline():
    assert np.isfinite(offsets(strip(60.0, skin=0.65), [60.0])).all()
    assert np.isnan(offsets(strip(60.0, skin=0.55), [60.0])).all()


def test_a_ramp_is_no_edge_and_masked_pixels_tell_nothing():
    ramp = strip(60.0)
    share = np.clip((66 - np.arange(SIDE)) / 12, 0, 1)[:, None]
    ramp.color[:] = share * FACE + (1 - share) * 0.1 * FACE
    assert np.isnan(offsets(ramp, [60.0])).all()
    masked = strip(60.0)
    masked.usable[:, 64] = False
    assert np.isnan(offsets(masked, [60.0])).all()
    masked.usable[:, 64], masked.usable[:, 70] = True, False
    assert np.isfinite(offsets(masked, [60.0])).all()


def test_an_edge_further_out_is_found_beyond_a_strip_of_skin():
    """Up to four reaches, a tenth of the face; only outward, only where it is asked for."""
    photo = strip(60.0)
    np.testing.assert_allclose(nearest(photo, [58.0, 55.0, 52.0, 50.5]), [2, 5, 8, 9.5], atol=0.06)
    assert np.isnan(nearest(photo, [47.0, 65.0])).all()
    assert np.isfinite(nearest(photo, [59.0], further=False)).all()
    assert np.isnan(nearest(photo, [54.0], further=False)).all()


def test_beyond_hair_or_cloth_no_edge_is_the_face_s():
    photo = strip(60.0)
    assert np.isfinite(nearest(photo, [56.2])).all()
    photo.skin[:, 56:60] = 0.0
    assert np.isnan(nearest(photo, [56.2])).all()


def test_an_edge_that_runs_another_way_is_not_the_outline_s():
    """The neck's edge, as one comes to it from the jaw's angle."""
    search = EdgeSearch(strip(60.0), FACE_PX)
    for degrees, seen in ((0.0, True), (25.0, True), (40.0, False), (-40.0, False)):
        assert np.isfinite(search.offset(*places([59.5], degrees)))[0] == seen
