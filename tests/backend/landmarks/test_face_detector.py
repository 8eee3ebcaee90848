"""The detector's arithmetic, against slow and obviously right code."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from facestage.landmarks.face_detector import (
    OVERLAP_MAX,
    Detections,
    anchors,
    concatenate,
    merge_overlapping,
    overlap,
)


def test_anchors_are_the_centres_of_two_grids():
    found = anchors()
    assert found.shape == (16 * 16 * 2 + 8 * 8 * 6, 2)
    np.testing.assert_allclose(
        found[:4], [[1 / 32, 1 / 32], [1 / 32, 1 / 32], [3 / 32, 1 / 32], [3 / 32, 1 / 32]]
    )
    np.testing.assert_allclose(found[512:519, 0], [1 / 16] * 6 + [3 / 16])
    np.testing.assert_allclose(found[-1], [15 / 16, 15 / 16])


squares = st.tuples(st.integers(0, 30), st.integers(0, 30), st.integers(1, 12))


@given(squares, st.lists(squares, max_size=5))
def test_overlap_is_that_of_counted_pixels(
    first: tuple[int, int, int], others: list[tuple[int, int, int]]
):
    def pixels(square: tuple[int, int, int]) -> set[tuple[int, int]]:
        left, top, side = square
        return {(x, y) for x in range(left, left + side) for y in range(top, top + side)}

    def box(square: tuple[int, int, int]) -> list[float]:
        return [square[0] + square[2] / 2, square[1] + square[2] / 2, square[2]]

    expected = [
        len(pixels(first) & pixels(other)) / len(pixels(first) | pixels(other)) for other in others
    ]
    found = overlap(np.array(box(first)), np.array([box(other) for other in others]).reshape(-1, 3))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def slow_merge(found: Detections) -> list[tuple[float, list[float], list[list[float]]]]:
    """One face at a time, one number at a time."""
    left = sorted(range(len(found)), key=lambda number: -found.scores[number])
    merged = []
    while left:
        best = left[0]
        same = [
            number
            for number in left
            if number == best
            or overlap(found.boxes[best], found.boxes[number : number + 1])[0] > OVERLAP_MAX
        ]
        total = sum(found.scores[number] for number in same)
        box = [sum(found.scores[n] * found.boxes[n, i] for n in same) / total for i in range(3)]
        points = [
            [
                sum(found.scores[n] * found.keypoints[n, k, i] for n in same) / total
                for i in range(2)
            ]
            for k in range(6)
        ]
        merged.append((found.scores[best], box, points))
        left = [number for number in left if number not in same]
    return merged


@given(st.integers(0, 2**32 - 1), st.integers(0, 25))
def test_merging_is_what_the_slow_way_gives(seed: int, count: int):
    rng = np.random.default_rng(seed)
    boxes = np.column_stack([rng.uniform(0, 60, (count, 2)), rng.uniform(10, 30, count)])
    found = Detections(boxes, rng.uniform(0, 60, (count, 6, 2)), rng.permutation(count) / 30 + 0.1)
    merged = merge_overlapping(found)
    expected = slow_merge(found)
    assert len(merged) == len(expected)
    for number, (score, box, points) in enumerate(expected):
        assert merged.scores[number] == score
        np.testing.assert_allclose(merged.boxes[number], box)
        np.testing.assert_allclose(merged.keypoints[number], points)


def test_nothing_merges_to_nothing():
    assert len(merge_overlapping(concatenate([]))) == 0


def test_roll_is_the_direction_of_the_eyes():
    keypoints = np.zeros((2, 6, 2))
    keypoints[0, 1] = [1, 1]
    keypoints[1, 1] = [-2, 0]
    np.testing.assert_allclose(
        Detections(np.zeros((2, 3)), keypoints, np.ones(2)).roll, [np.pi / 4, np.pi]
    )
