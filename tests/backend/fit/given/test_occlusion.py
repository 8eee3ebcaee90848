"""What hides a face without looking like one: boards are found, shadows and faces are not."""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.given.occlusion import flat_occluders, without
from reference.synthetic_scene import SIDE, Scene, plain_photo

FACE_PX = 60.0


@pytest.fixture(scope="module")
def rendered(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    return scene.render(samples=16)


def board(photo: np.ndarray, seen: np.ndarray, share: float) -> np.ndarray:
    """The photo with its lower half behind an even board of ``share`` times the skin's median."""
    covered = photo.copy()
    covered[SIDE // 2 :] = share * np.median(photo[seen], axis=0)
    return covered


def test_a_face_is_not_hidden_by_itself(rendered: tuple[np.ndarray, np.ndarray]):
    photo, seen = rendered
    assert not flat_occluders(photo, photo, seen, FACE_PX).any()
    # Another face, a few pixels away and twice as bright, has contrast all the same.
    both = seen & np.roll(seen, 3, axis=1)
    assert not flat_occluders(photo, 2 * np.roll(photo, 3, axis=1), both, FACE_PX).any()


@pytest.mark.parametrize("share", [0.6, 1.0, 1.5])
def test_a_board_is_found_to_its_edge(rendered: tuple[np.ndarray, np.ndarray], share: float):
    photo, seen = rendered
    noise = 1 + 0.002 * np.random.default_rng(2).normal(size=photo.shape)
    hidden = flat_occluders(board(photo, seen, share) * noise, photo, seen, FACE_PX)
    below = np.zeros_like(seen)
    below[SIDE // 2 :] = True
    print(
        f"hidden {hidden[seen & below].mean():.3f} of what is, {hidden[seen & ~below].mean():.3f} "
        "of what is not"
    )
    assert hidden[seen & below].mean() > 0.99
    assert not hidden[: SIDE // 2 - 3].any()


def test_shadow_is_not_a_board(rendered: tuple[np.ndarray, np.ndarray]):
    photo, seen = rendered
    assert not flat_occluders(board(photo, seen, 0.1), photo, seen, FACE_PX).any()


def test_what_is_unknown_hides_nothing(rendered: tuple[np.ndarray, np.ndarray]):
    photo, seen = rendered
    assert not flat_occluders(
        np.full_like(photo, np.nan), photo, np.zeros_like(seen), FACE_PX
    ).any()
    damaged = photo.copy()
    damaged[::7, ::5] = np.nan
    assert not flat_occluders(damaged, photo, seen & np.isfinite(damaged).all(2), FACE_PX).any()
    assert not flat_occluders(np.zeros_like(photo), photo, seen, FACE_PX).any()


def test_hidden_pixels_are_no_skin():
    photo = plain_photo(np.ones((4, 4, 3)))
    hidden = np.eye(4, dtype=bool)
    np.testing.assert_array_equal(without(photo, hidden).skin, 1.0 - hidden)
