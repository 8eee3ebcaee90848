"""One texture from several photos: what only one shows is that photo's, what both show lies
between.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.fit.face.state import State
from facestage.fit.textures.merged_texture import BASIS, MergedTexture
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


@pytest.fixture
def merged(scene: Scene) -> MergedTexture:
    """Over a basis of 0.5."""
    return MergedTexture(scene.geometry, SIZE, np.full((len(scene.geometry.mean), 3), 0.5))


MIDDLE = slice(SIZE // 4, 3 * SIZE // 4)


def test_what_one_photo_shows_is_filled_in(merged: MergedTexture, frontal: State):
    left, right = halves()
    merged.add(flat(0.2), left, frontal, 1.0)
    merged.add(flat(0.8), right, frontal, 1.0)
    assert merged.coverage.all()
    # 0.2 and 0.8, drawn a little to the basis.
    assert (merged.mean()[MIDDLE, SIZE // 4] < 0.3).all() and (
        merged.mean()[MIDDLE, -SIZE // 4] > 0.7
    ).all()


def test_what_no_photo_shows_is_the_basis(merged: MergedTexture, frontal: State):
    left, right = halves()
    merged.add(flat(0.2), left, frontal, 1.0)
    np.testing.assert_allclose(merged.mean()[right], 0.5, rtol=1e-6)
    np.testing.assert_array_equal(merged.coverage, left)


def test_the_basis_takes_the_tone_of_the_photos(
    merged: MergedTexture, frontal: State, scene: Scene
):
    left, right = halves()
    merged.add(flat(0.2), left, frontal, 1.0)
    tone = np.full((len(scene.geometry.mean), 3), -0.1)
    np.testing.assert_allclose(merged.mean(tone)[right], 0.4, rtol=1e-6)
    assert np.abs(merged.mean(tone) - merged.mean())[MIDDLE, SIZE // 4].max() < 0.03


def test_what_both_show_counts_by_its_weight(merged: MergedTexture, frontal: State):
    everywhere = np.ones((SIZE, SIZE), bool)
    merged.add(flat(0.2), everywhere, frontal, 0.25)
    merged.add(flat(0.4), everywhere, frontal, 1.0)
    full = (0.25 * 0.2 + 0.4 + BASIS * 0.5) / (1.25 + BASIS)
    assert merged.mean().min() == pytest.approx(full, rel=1e-3)


def test_the_photo_that_sees_a_place_straight_on_decides(merged: MergedTexture, frontal: State):
    everywhere = np.ones((SIZE, SIZE), bool)
    turned = replace(frontal, rotation=Rotation.from_rotvec([0, 1.0, 0]).as_matrix())
    merged.add(flat(0.2), everywhere, frontal, 1.0)
    merged.add(flat(0.6), everywhere, turned, 1.0)
    texture = merged.mean()[MIDDLE, ..., 0].mean(axis=0)
    sides = texture[SIZE // 8], texture[-SIZE // 8]
    print(
        f"on either side {sides[0]:.3f} and {sides[1]:.3f}, in the middle {texture[SIZE // 2]:.3f}"
    )
    assert abs(sides[0] - sides[1]) > 0.05
    assert texture.min() >= 0.2 and texture.max() <= 0.6
