"""One texture from several photos: what only one shows is that photo's, what both show lies between."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.fit.merged_texture import MergedTexture
from facestage.fit.parameters import State
from reference.synthetic_scene import Scene

SIZE = 64


@pytest.fixture
def frontal(scene: Scene) -> State:
    return replace(scene.state, rotation=np.eye(3))


def halves() -> tuple[np.ndarray, np.ndarray]:
    left = np.zeros((SIZE, SIZE), bool)
    left[:, : SIZE // 2] = True
    return left, ~left


def flat(value: float) -> np.ndarray:
    return np.full((SIZE, SIZE, 3), value)


def test_what_one_photo_shows_is_filled_in(scene: Scene, frontal: State):
    left, right = halves()
    merged = MergedTexture(scene.geometry, SIZE)
    merged.add(flat(0.2), left, frontal, 100)
    merged.add(flat(0.6), right, frontal, 100)
    texture = merged.mean()
    assert merged.coverage.all()
    middle = slice(SIZE // 4, 3 * SIZE // 4)
    np.testing.assert_allclose(texture[middle, SIZE // 4], 0.2, rtol=0.02)
    np.testing.assert_allclose(texture[middle, -SIZE // 4], 0.6, rtol=0.02)


def test_what_both_show_counts_by_its_pixels(scene: Scene, frontal: State):
    everywhere = np.ones((SIZE, SIZE), bool)
    merged = MergedTexture(scene.geometry, SIZE)
    merged.add(flat(0.2), everywhere, frontal, 100)
    merged.add(flat(0.4), everywhere, frontal, 200)
    np.testing.assert_allclose(merged.mean(), (0.2 + 4 * 0.4) / 5, rtol=1e-5)


def test_the_photo_that_sees_a_place_straight_on_decides(scene: Scene, frontal: State):
    everywhere = np.ones((SIZE, SIZE), bool)
    turned = replace(frontal, rotation=Rotation.from_rotvec([0, 1.0, 0]).as_matrix())
    merged = MergedTexture(scene.geometry, SIZE)
    merged.add(flat(0.2), everywhere, frontal, 100)
    merged.add(flat(0.6), everywhere, turned, 100)
    texture = merged.mean()[SIZE // 4 : 3 * SIZE // 4, ..., 0].mean(axis=0)
    sides = texture[SIZE // 8], texture[-SIZE // 8]
    print(f"texture on either side {sides[0]:.3f} and {sides[1]:.3f}, in the middle {texture[SIZE // 2]:.3f}")
    assert abs(sides[0] - sides[1]) > 0.05
    assert texture.min() >= 0.2 and texture.max() <= 0.6
