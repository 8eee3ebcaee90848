"""The drawing over the view is where the points are."""

from __future__ import annotations

import numpy as np
import pytest

from addon.landmarks.views import made_up, set_view


@pytest.mark.parametrize("name", ["plain", "portrait", "scaled"])
def test_drawing_is_over_the_points(scene, name: str) -> None:
    """What is drawn over the camera's view lies where its picture has the landmarks."""
    import bpy

    from facestage_blender.landmarks.empties import landmark_empties, show_landmarks
    from facestage_blender.landmarks.overlay import (
        current_landmarks,
        discs_by_color,
        line_ends,
        on_screen,
    )

    width, height = size = set_view(scene, name)
    given = made_up(*size, "mediapipe478")
    show_landmarks(scene, given, *size)
    bpy.context.view_layer.update()
    window = scene.camera.calc_matrix_camera(
        bpy.context.evaluated_depsgraph_get(), x=width, y=height
    )
    view = np.array(window @ scene.camera.matrix_world.normalized().inverted())
    landmarks = current_landmarks(scene)
    assert landmarks is not None
    pixels = (on_screen(scene, landmarks, view) * [0.5, -0.5] + 0.5) * size
    np.testing.assert_allclose(pixels, given.points, atol=0.02)
    discs = discs_by_color(scene, landmarks, pixels, 1.0)
    counts = [len(triangles) // 24 for _, triangles in discs]
    states = [item.facestage_landmark.state for item in landmark_empties(scene)]
    assert counts == [478 - len(states), 0, states.count("VISIBLE"), states.count("HIDDEN"), 0]
    assert len(line_ends(landmarks, pixels)) == 2 * (16 + 4 + 4 + 3 + 4 + 6 + 6 + 12 + 8)
    # Behind the view nothing is drawn.
    turned = np.array(window @ scene.camera.matrix_world.normalized().inverted()) * [
        [1],
        [1],
        [1],
        [-1],
    ]
    assert not len(line_ends(landmarks, on_screen(scene, landmarks, turned)))
    landmark_empties(scene)[0].location.x += 0.1
    bpy.context.view_layer.update()
    assert current_landmarks(scene) is not landmarks


def test_what_is_drawn_is_made_anew_only_when_it_changed(scene) -> None:
    from facestage_blender.landmarks.screen_drawing import ScreenDrawing

    made: list[str] = []

    def make() -> int:
        made.append("again")
        return len(made)

    drawing: ScreenDrawing[int] = ScreenDrawing(lambda: None)
    assert [drawing.kept(of, make) for of in ("a", "a", "b", "b", "a")] == [1, 1, 2, 2, 3]
    drawing.unregister()
    assert drawing.kept("a", make) == 4
