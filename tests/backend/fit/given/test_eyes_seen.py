"""Which pixels show iris and white: an eye drawn in pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.fit.given.eyes_seen import IRIS_INSIDE, WHITE_OUTSIDE, EyesSeen
from facestage.models.anatomy.landmark_schemes import scheme_of

SIZE, WIDTH, RADIUS = (120, 200), 60.0, 14.0
CENTRES = np.array([[50.0, 60.5], [150.0, 60.5]])


def eyes(height: float, angle: float = 0.0) -> Landmarks:
    """Two eyes of WIDTH pixels whose lids are two parabolas, ``height`` pixels apart, turned by
    ``angle`` about their centres.
    """
    points = np.full((478, 2), 10.0)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    for eye, ring, centre in zip(
        scheme_of("mediapipe478").eyes, scheme_of("mediapipe478").openings[1:], CENTRES, strict=True
    ):
        outwards = -1.0 if eye is scheme_of("mediapipe478").eyes[0] else 1.0
        # From the outer corner along the lower lid to the inner one, and back.
        along = np.interp(np.arange(16), [0, 8, 16], [1.0, -1.0, 1.0])
        lid = np.where(np.arange(16) <= 8, 1.0, -1.0) * (1 - along**2) * height / 2
        drawn = np.stack([outwards * along * WIDTH / 2, lid], axis=1)
        points[ring] = centre + drawn @ turn.T
        around = RADIUS * np.array([[0, 0], [1, 0], [0, -1], [-1, 0], [0, 1]])
        points[list(eye.iris)] = centre + around @ turn.T
    return Landmarks("mediapipe478", points, np.ones(478, bool))


def distance() -> np.ndarray:
    """(h, w) in radii of the iris from the nearer eye's centre."""
    y, x = np.mgrid[: SIZE[0], : SIZE[1]] + 0.5
    return np.min([np.hypot(x - cx, y - cy) for cx, cy in CENTRES], axis=0) / RADIUS


def test_iris_and_white_are_told_apart():
    seen = EyesSeen.of(SIZE, eyes(24.0))
    assert seen is not None
    away = distance()
    low, high = IRIS_INSIDE
    assert away[seen.iris].min() > low and away[seen.iris].max() < high
    assert away[seen.white].min() > WHITE_OUTSIDE
    # Both eyes alike, and as much as lies between the lids.
    for shown in (seen.iris, seen.white):
        assert abs(int(shown[:, :100].sum()) - int(shown[:, 100:].sum())) < 12
    assert 0.8 < seen.iris.sum() / (2 * np.pi * RADIUS**2 * (high**2 - low**2)) < 1.0


def test_nothing_beyond_the_lids_is_an_eye():
    seen = EyesSeen.of(SIZE, eyes(12.0))
    assert seen is not None
    row = np.nonzero(seen.iris | seen.white)[0]
    assert row.min() >= 54 and row.max() <= 66


def test_the_way_from_the_upper_lid_is_known_in_turned_eyes_too():
    for angle in (0.0, 0.5):
        seen = EyesSeen.of(SIZE, eyes(24.0, angle))
        assert seen is not None
        for cx, cy in CENTRES:
            # In the middle the border is 12 pixels above the centre, half way to a corner 9.
            for along, above in ((0.0, 12.0), (0.25 * WIDTH, 9.0), (-0.25 * WIDTH, 9.0)):
                x, y = cx + np.cos(angle) * along, cy + np.sin(angle) * along
                assert abs(seen.below_lid[int(y), int(x)] * RADIUS - above) < 1.0
        assert np.isnan(seen.below_lid[0, 0])


def test_shut_eyes_and_points_without_irises_say_nothing():
    assert EyesSeen.of(SIZE, eyes(4.0)) is None
    hidden = eyes(24.0)
    assert EyesSeen.of(SIZE, replace(hidden, visible=np.zeros(478, bool))) is None
    assert EyesSeen.of(SIZE, Landmarks("ibug68", np.zeros((68, 2)), np.ones(68, bool))) is None
