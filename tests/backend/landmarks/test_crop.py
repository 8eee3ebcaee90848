"""Squares of a photo: points go in and come out at the same place, and so do pixels."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from facestage.contract.files.color import srgb_to_linear
from facestage.images.image_io import Photograph
from facestage.landmarks.crop import Crop, crop_around
from facestage.landmarks.views import PhotoViews

crops = st.builds(
    lambda x, y, side, angle, mirrored: Crop(np.array([x, y]), side, angle, mirrored),
    st.floats(-1e4, 1e4),
    st.floats(-1e4, 1e4),
    st.floats(0.1, 1e4),
    st.floats(-10, 10),
    st.booleans(),
)
POINTS = np.random.default_rng(0).uniform(-1, 2, (50, 2))


@given(crops)
def test_points_return_to_where_they_were(crop: Crop):
    there = crop.to_photo(POINTS)
    np.testing.assert_allclose(
        crop.from_photo(there), POINTS, atol=1e-7 * (1 + np.abs(crop.center).max() / crop.side)
    )
    np.testing.assert_allclose(
        crop.mirror().from_photo(there), [1, 0] + [-1, 1] * crop.from_photo(there), atol=1e-12
    )


def test_known_corners():
    upright = Crop(np.array([10.0, 20.0]), 4.0)
    np.testing.assert_allclose(
        upright.to_photo(np.array([[0, 0], [1, 0], [1, 1]])), [[8, 18], [12, 18], [12, 22]]
    )
    turned = Crop(np.array([10.0, 20.0]), 4.0, np.pi / 2)  # its x axis points down
    np.testing.assert_allclose(
        turned.to_photo(np.array([[0.5, 0.5], [1, 0.5]])), [[10, 20], [10, 22]], atol=1e-12
    )


@given(st.floats(-7, 7), st.floats(1, 3))
def test_a_crop_around_points_holds_them_in_its_middle(angle: float, margin: float):
    points = POINTS @ np.array([[30.0, 0], [0, 10]]) + [100, 50]
    inside = crop_around(points, angle, margin).from_photo(points)
    low, high = inside.min(axis=0), inside.max(axis=0)
    np.testing.assert_allclose(low + high, 1, atol=1e-9)
    assert (high - low).max() == pytest.approx(1 / margin)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi])
@pytest.mark.parametrize(("side", "size"), [(40.0, 128), (180.0, 128), (700.0, 64)])
def test_a_dot_appears_where_the_crop_says(side: float, size: int, angle: float, mirrored: bool):
    width, height, place = 331, 217, np.array([140.3, 101.8])
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    radius = max(2.0, 2 * side / size)
    dot = np.exp(-((x - place[0]) ** 2 + (y - place[1]) ** 2) / (2 * radius**2))
    photograph = Photograph(
        np.repeat(dot[..., None], 3, axis=2).astype(np.float32),
        np.ones((height, width), bool),
        np.zeros((height, width, 3), bool),
    )
    crop = Crop(place + side * np.array([0.21, -0.13]), side, angle, mirrored)
    view = srgb_to_linear(PhotoViews(photograph).sample(crop, size, repeat_border=False))[..., 0]
    centre = (np.arange(size) + 0.5) / size
    seen = (
        np.array([(view.sum(axis=0) * centre).sum(), (view.sum(axis=1) * centre).sum()])
        / view.sum()
    )
    # A twentieth of a pixel of the view, or of the photo where that is coarser.
    np.testing.assert_allclose(seen, crop.from_photo(place), atol=0.05 * max(1 / size, 1 / side))


def test_nothing_is_skipped_when_a_view_is_smaller_than_the_photo(
    photo_of: Callable[[np.ndarray], Photograph],
):
    stripes = np.tile(np.array([0, 255], np.uint8), (512, 256))
    view = PhotoViews(photo_of(stripes)).sample(
        Crop(np.array([256.0, 256.0]), 512.0), 64, repeat_border=True
    )
    np.testing.assert_allclose(srgb_to_linear(view), 0.5, atol=0.01)


def test_what_lies_outside_is_black_or_the_border(photo_of: Callable[[np.ndarray], Photograph]):
    views = PhotoViews(photo_of(np.full((20, 20), 200, np.uint8)))
    crop = Crop(np.array([0.0, 0.0]), 20.0)
    assert views.sample(crop, 32, repeat_border=False)[:8, :8].max() == 0
    np.testing.assert_allclose(views.sample(crop, 32, repeat_border=True), 200 / 255, atol=0.01)


def test_a_linear_photo_of_any_brightness_is_exposed():
    rng = np.random.default_rng(0)
    color = rng.uniform(0, 1, (40, 50, 3)).astype(np.float32)
    mask, clipped = np.ones((40, 50), bool), np.zeros((40, 50, 3), bool)
    views = {
        scale: PhotoViews(Photograph(color * np.float32(scale), mask, clipped))
        for scale in (1.0, 1e-5, 1e4)
    }
    assert views[1.0].gain == views[1e-5].gain == 1, (
        "a picture that a display can show is not touched at first"
    )
    assert views[1e4].gain == pytest.approx(views[1e4].exposure_gain)
    assert views[1.0].gains() == [1.0] and len(views[1e-5].gains()) == 2
    for scale, view in views.items():
        assert view.exposure_gain * scale == pytest.approx(views[1.0].exposure_gain, rel=1e-4)
    black = PhotoViews(Photograph(0 * color, mask, clipped))
    assert black.gain == black.exposure_gain == 1
