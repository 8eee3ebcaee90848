"""The landmark residuals and their exact Jacobian."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.landmark_term import HIDDEN_SIGMA, LandmarkTerm, PlacedLandmarks
from facestage.fit.face.layout import Layout
from reference.synthetic_scene import Scene, moved


def term_of(scene: Scene, noise_px: float = 3.0) -> PlacedLandmarks:
    return LandmarkTerm(scene.geometry, scene.landmarks(noise_px=noise_px), 1.5).at(scene.state)


@pytest.mark.parametrize("block", ["pose", "focal", "identity", "expression"])
def test_jacobian_equals_finite_differences(scene: Scene, block: str):
    term, layout = term_of(scene), Layout(scene.state)
    jacobian = term.jacobian(scene.state, layout)
    step = 1e-5
    for column in range(layout.slices[block].start, layout.slices[block].stop):
        increment = np.zeros(layout.size)
        increment[column] = step
        plus, minus = (
            term.residuals(layout.apply(scene.state, sign * increment)) for sign in (1, -1)
        )
        wanted = (plus - minus) / (2 * step)
        error = np.abs(jacobian[:, column] - wanted).max() / np.abs(wanted).max()
        print(
            f"{block}[{column - layout.slices[block].start}]: error {error:.1e}, margin "
            f"{1e-6 / max(error, 1e-16):.0f}x"
        )
        assert error < 1e-6


def test_other_parameters_do_not_move_landmarks(scene: Scene):
    layout = Layout(scene.state)
    jacobian = term_of(scene).jacobian(scene.state, layout)
    assert not jacobian[:, layout.mask(("lights", "albedo", "roughness", "specular"))].any()


def test_residuals_vanish_at_the_truth_and_count_standard_deviations(scene: Scene):
    exact = LandmarkTerm(scene.geometry, scene.landmarks(), 1.5).at(scene.state)
    assert np.abs(exact.residuals(scene.state)).max() < 1e-3
    landmarks = scene.landmarks()
    points = landmarks.points.copy()
    points[[3, 40]] += [3.0, 0.0]
    visible = landmarks.visible.copy()
    visible[50] = False
    points[50] += [0.0, 3.0]
    shifted = LandmarkTerm(scene.geometry, Landmarks("ibug68", points, visible), 1.5).at(
        scene.state
    )
    residual = shifted.residuals(scene.state).reshape(-1, 2)
    assert residual[40, 0] == pytest.approx(-2, abs=1e-2)
    assert residual[3, 0] == pytest.approx(-2 / 1.5, abs=1e-2), "the outline is on no feature"
    assert residual[50, 1] == pytest.approx(-2 / HIDDEN_SIGMA, abs=1e-2), (
        "a hidden point is a guess"
    )


def test_an_unknown_hidden_point_says_nothing(scene: Scene):
    landmarks = scene.landmarks()
    points = landmarks.points.copy()
    points[30] = np.nan
    term = LandmarkTerm(scene.geometry, Landmarks("ibug68", points, np.arange(68) != 30), 1.5).at(
        scene.state
    )
    residual = term.residuals(scene.state).reshape(-1, 2)
    jacobian = term.jacobian(scene.state, Layout(scene.state)).reshape(68, 2, -1)
    assert np.isfinite(residual).all() and not residual[30].any()
    assert np.isfinite(jacobian).all() and not jacobian[30].any()


def test_robust_weights_fall_with_the_distance_of_the_point(scene: Scene):
    term = term_of(scene)
    residuals = np.zeros((68, 2))
    residuals[1, 0], residuals[2, 1] = 3.0, 30.0
    weights = term.robust_weights(residuals.ravel()).reshape(-1, 2)[:3]
    np.testing.assert_allclose(weights[:, 0], weights[:, 1])
    np.testing.assert_allclose(weights[:, 0], [1.0, 0.5, 1 / 101])


def test_a_face_behind_the_camera_is_no_number(scene: Scene):
    behind = replace(scene.state, translation=np.array([0, 0, 0.6]))
    assert np.isnan(term_of(scene).residuals(behind)).any()
    assert np.isfinite(
        term_of(scene).residuals(moved(scene.state, pose=[0.3, 0, 0, 0, 0, -0.2]))
    ).all()
