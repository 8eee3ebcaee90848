"""Large photos are worked on at a smaller size, and everything comes back in pixels of the whole
photo.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.fineness import USUAL
from facestage.fit.given.window import Window
from facestage.images.image_io import Photograph


def landmarks(center: tuple[float, float], side: float) -> Landmarks:
    random = np.random.default_rng(0)
    points = np.array(center) + side * (random.random((68, 2)) - 0.5)
    points[:2] = np.array(center) + side * np.array([[-0.5, -0.5], [0.5, 0.5]])
    return Landmarks("ibug68", points, np.ones(68, bool))


def test_a_small_photo_is_left_alone():
    window = Window.of(1000, 1000, landmarks((500, 500), 600))
    photo = Photograph(
        np.ones((1000, 1000, 3), np.float32),
        np.ones((1000, 1000), bool),
        np.zeros((1000, 1000, 3), bool),
    )
    camera = Camera.default(1000, 1000)
    assert window.whole and window.photograph(photo) is photo
    assert window.camera(camera) is camera and window.enlarged(photo.color) is photo.color
    assert window.words == "1000 x 1000"


def test_a_large_face_of_a_small_photo_is_made_smaller_where_that_is_asked_for():
    """All of the photo stays, so that it can be relit whole."""
    marks = landmarks((400, 500), 600)
    window = Window.of(1000, 900, marks, replace(USUAL, whole_face_px=300.0))
    assert window.uncut and not window.whole and window.size == (500, 450)
    assert np.ptp(window.landmarks(marks).points, axis=0).max() == pytest.approx(300)
    # Not for a little.
    assert Window.of(1000, 900, marks, replace(USUAL, whole_face_px=500.0)).whole


@pytest.mark.parametrize(
    ("center", "side"), [((2000, 1500), 1500), ((3600, 400), 300), ((100, 2900), 1200)]
)
def test_camera_and_points_agree_in_both_frames(center: tuple[float, float], side: float):
    window, marks = Window.of(4000, 3000, landmarks(center, side)), landmarks(center, side)
    camera = Camera(4000, 3000, 3600.0, (2010.0, 1480.0))
    assert not window.whole and np.prod(window.size) < 3 * USUAL.photo_pixels
    points = np.random.default_rng(1).normal(size=(20, 3)) * 0.05 + [0, 0, -0.7]
    own, moved = window.camera(camera), window.landmarks(marks)
    corner = np.array(window.box[:2])
    np.testing.assert_allclose(
        own.project(points), (camera.project(points) - corner) * window.factor
    )
    np.testing.assert_allclose(moved.points / window.factor + corner, marks.points)
    back = window.full_camera(own)
    assert (back.width, back.height) == (4000, 3000) and back.focal_px == pytest.approx(3600)
    np.testing.assert_allclose(back.principal_px, camera.principal_px)
    assert np.ptp(moved.points, axis=0).max() <= USUAL.face_px + 1e-6
    assert (own.width, own.height) == window.size


def test_pixels_lie_where_the_camera_says():
    """A picture of its own coordinates: its window's pixels, put back, are the same coordinates."""
    y, x = np.mgrid[:3000, :4000].astype(np.float32) + 0.5
    ramp = np.stack([x, y, x + y], axis=-1)
    clipped = np.repeat((x > 2000)[..., None], 3, axis=2)
    window = Window.of(4000, 3000, landmarks((2100, 1400), 1300))
    photo = window.photograph(Photograph(ramp, x < 3000, clipped))
    assert photo.size == window.size
    rows, columns = np.mgrid[: photo.size[1], : photo.size[0]] + 0.5
    left, top = window.box[:2]
    # Sizes are whole pixels: half a pixel at the far side, and what OpenCV's area average does at
    # the border.
    for channel, expected in ((0, columns / window.factor + left), (1, rows / window.factor + top)):
        difference = np.abs(photo.color[..., channel] - expected)
        assert np.percentile(difference, 99) < 0.5 / window.factor + 0.1
        assert difference.max() < 2 / window.factor
    assert (
        not photo.mask[:, photo.color[0, :, 0] > 3000].any()
        and photo.mask[:, photo.color[0, :, 0] < 2990].all()
    )
    assert (
        photo.clipped[:, photo.color[0, :, 0] > 2003].all()
        and not photo.clipped[:, photo.color[0, :, 0] < 1997].any()
    )
    back = window.enlarged(photo.color)
    assert back.shape == (3000, 4000, 3)
    inner = np.s_[top + 5 : window.box[3] - 5, left + 5 : window.box[2] - 5]
    np.testing.assert_allclose(back[inner][..., :2], ramp[inner][..., :2], atol=2)
