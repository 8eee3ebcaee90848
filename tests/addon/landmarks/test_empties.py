"""Landmarks read back from their empties: what follows, what is hidden, what is kept."""

from __future__ import annotations

import numpy as np

from addon.landmarks.views import made_up, set_view
from reference.known import known


def test_followers_follow_what_is_dragged(scene) -> None:
    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )
    from facestage_blender.landmarks.scheme import handles

    size = set_view(scene, "plain")
    given = made_up(*size, "mediapipe478")
    show_landmarks(scene, given, *size)
    empties = landmark_empties(scene)
    assert len(empties) == len(handles("mediapipe478", 478)) < 80
    for empty in empties:
        empty.location.x += 12.5 / 640
        empty.location.y += 5 / 640
    np.testing.assert_allclose(
        edited_landmarks(scene).points, given.points + np.array([12.5, -5]), atol=1e-2
    )


def test_a_hidden_handle_hides_what_is_around_it(scene) -> None:
    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )

    size = set_view(scene, "plain")
    given = made_up(*size, "mediapipe478")
    show_landmarks(scene, given, *size)
    empties = landmark_empties(scene)
    handle = next(item for item in empties if item.facestage_landmark.state == "VISIBLE")
    looks = handle.empty_display_size
    handle.facestage_landmark.state = "HIDDEN"
    assert handle.empty_display_size < looks
    now = edited_landmarks(scene)
    np.testing.assert_array_equal(now.points, given.points)
    changed = np.flatnonzero(now.visible != given.visible)
    indices = np.array([item.facestage_landmark.index for item in empties])
    distance = np.linalg.norm(given.points[:, None] - given.points[indices], axis=2)
    nearest = indices[distance.argmin(axis=1)]
    np.testing.assert_array_equal(
        changed, np.flatnonzero((nearest == handle.facestage_landmark.index) & given.visible)
    )


def test_weights_of_a_file_are_kept(scene) -> None:
    from dataclasses import replace

    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )

    size = set_view(scene, "plain")
    given = replace(made_up(*size), weights=np.arange(68) / 10)
    show_landmarks(scene, given, *size)
    empties = landmark_empties(scene)
    assert [item.facestage_landmark.state for item in empties].count("IGNORED") == 1
    assert edited_landmarks(scene).to_json() == given.to_json()
    empties[0].facestage_landmark.state = "VISIBLE"
    empties[7].facestage_landmark.state = "IGNORED"
    expected = np.arange(68) / 10
    expected[[0, 7]] = 1, 0
    np.testing.assert_array_equal(known(edited_landmarks(scene).weights), expected)
    empties[7].facestage_landmark.state = "HIDDEN"
    now = edited_landmarks(scene)
    assert known(now.weights)[7] == 0.7 and not now.visible[7]


def test_a_landmark_without_position_waits_on_the_photo(scene) -> None:
    from facestage_blender.landmarks.empties import (
        edited_landmarks,
        landmark_empties,
        show_landmarks,
    )

    size = set_view(scene, "plain")
    given = made_up(*size)
    given.points[3], given.visible[3] = np.nan, False
    show_landmarks(scene, given, *size)
    assert np.isnan(edited_landmarks(scene).points[3]).all()
    empty = landmark_empties(scene)[3]
    empty.location, empty.facestage_landmark.state = (0.1, 0.1, 0), "VISIBLE"
    now = edited_landmarks(scene)
    np.testing.assert_allclose(now.points[3], [320 + 64, 240 - 64], atol=1e-3)
    assert now.visible[3]
