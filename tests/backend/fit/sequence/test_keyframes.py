"""Which frames a person is fitted to."""

from __future__ import annotations

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.fit.sequence.keyframes import choose_keyframes


def frame(turn: float, mouth: float = 0.0) -> Landmarks:
    """A face of random points, squeezed as by a turn, its lower half moved as by a jaw."""
    points = np.random.default_rng(0).uniform(-1, 1, (478, 2))
    points[points[:, 1] > 0, 1] += mouth
    return Landmarks("mediapipe478", 100 + 40 * points * [1 - turn, 1], np.ones(478, bool))


def test_the_frames_that_differ_most_are_taken_and_one_that_is_usual():
    film: list[Landmarks | None] = [frame(0.0)] * 200
    film += [*[frame(0.4)] * 10, *[frame(0, 0.5)] * 10, None]
    chosen = choose_keyframes(film, [1.0] * 220 + [0.0], count=3)
    assert len(chosen) == 3
    assert chosen[0] < 200 <= chosen[1] < 210 <= chosen[2] < 220


def test_a_face_that_only_moves_and_grows_gives_one_keyframe():
    still = frame(0.0)
    film = [
        Landmarks(still.scheme, still.points * (1 + k / 9) + k, still.visible) for k in range(9)
    ]
    assert len(choose_keyframes(film, [1.0] * 9, count=4)) == 1


def test_what_is_hardly_a_face_is_not_taken():
    film = [*(frame(0.01 * k) for k in range(10)), frame(0.6)]
    assert 10 not in choose_keyframes(film, [1.0] * 10 + [0.5], count=4)
    assert choose_keyframes([None, None], [0.0, 0.0], count=4) == []
