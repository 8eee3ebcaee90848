"""Where a fit starts: the pose from landmarks, the lights from the photo."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.stages.initialize import LIGHT_RIDGE, initial_lights, initial_pose
from reference.synthetic_scene import RADIANCE, Scene, plain_photo

NEUTRAL: dict[str, Any] = {"identity": np.zeros(4), "expression": np.zeros(3)}


def angle_degrees(found: np.ndarray, wanted: np.ndarray) -> float:
    return float(np.degrees(np.linalg.norm(Rotation.from_matrix(found @ wanted.T).as_rotvec())))


@pytest.mark.parametrize("turn", [(0, 0, 0), (0.1, 0.3, -0.1), (-0.2, -0.6, 0.15), (0.3, 0.1, 0.5)])
def test_pose_of_the_mean_face(scene: Scene, turn: tuple[float, float, float]):
    """Weak perspective is an approximation: what is left is for the solver, which starts here."""
    state = replace(
        scene.state,
        **NEUTRAL,
        rotation=Rotation.from_rotvec(turn).as_matrix(),
        translation=np.array([0.02, 0.01, -0.7]),
    )
    rotation, translation = initial_pose(scene.geometry, scene.landmarks(state), state.camera)
    off = angle_degrees(rotation, state.rotation)
    depth = abs(translation[2] / state.translation[2] - 1)
    print(f"turn {turn}: {off:.2f} degrees off, depth off by {100 * depth:.1f} %")
    assert np.linalg.det(rotation) == pytest.approx(1)
    assert off < 6 and depth < 0.06
    assert np.linalg.norm(translation[:2] - state.translation[:2]) < 0.01


def test_a_far_face_is_placed_exactly(scene: Scene):
    """Far away weak perspective becomes exact."""
    state = replace(scene.state, **NEUTRAL, translation=np.array([0.0, 0.0, -60.0]))
    state = replace(state, camera=replace(state.camera, focal_px=20000.0))
    rotation, translation = initial_pose(scene.geometry, scene.landmarks(state), state.camera)
    off = angle_degrees(rotation, state.rotation)
    print(f"far face: {off:.3f} degrees off")
    assert off < 0.3
    np.testing.assert_allclose(translation, state.translation, rtol=5e-3, atol=1e-3)


def test_gross_outliers_are_taken_out(scene: Scene):
    state = replace(scene.state, **NEUTRAL)
    exact = scene.landmarks(state)
    points = exact.points.copy()
    points[[20, 33, 47, 60]] += [[40, -30], [-50, 10], [30, 45], [-20, -60]]
    clean = initial_pose(scene.geometry, exact, state.camera)
    rotation, translation = initial_pose(
        scene.geometry, Landmarks("ibug68", points, exact.visible), state.camera
    )
    assert angle_degrees(rotation, clean[0]) < 1.5
    assert np.linalg.norm(translation - clean[1]) < 0.01


def test_hidden_unknown_points_are_ignored(scene: Scene):
    state = replace(scene.state, **NEUTRAL)
    exact = scene.landmarks(state)
    points, visible = exact.points.copy(), exact.visible.copy()
    points[:8], visible[:8] = np.nan, False
    rotation, translation = initial_pose(
        scene.geometry, Landmarks("ibug68", points, visible), state.camera
    )
    assert np.isfinite(rotation).all() and np.isfinite(translation).all()
    assert angle_degrees(rotation, state.rotation) < 6


def evaluated(
    scene: Scene, lights: LightParameters, state: State, photo: np.ndarray
) -> tuple[Evaluation, PhotoTerm]:
    """The photo term with other light parameters, and its evaluation."""
    forward = ForwardModel(scene.geometry, lights)
    term = PhotoTerm(forward, plain_photo(photo), scene.stage, 8)
    return term.evaluate(state, 5), term


@pytest.mark.parametrize(("ridge", "bound"), [(1e-9, 1e-3), (LIGHT_RIDGE, 0.08)])
def test_lights_of_a_noiseless_image(scene: Scene, ridge: float, bound: float):
    """On the true geometry, albedo and gloss, with the same light samples, the lights come back."""
    photo, _ = scene.render(samples=8, seed=5)
    evaluation, term = evaluated(scene, scene.lights, scene.state, photo)
    error = (
        np.abs(initial_lights(evaluation, term, scene.lights, ridge) - RADIANCE).max(1)
        / RADIANCE.max()
    )
    print(
        f"ridge {ridge:.0e}: lights off by {100 * error.max():.3f} % of the brightest, allowed "
        f"{100 * bound:.1f} %"
    )
    # The ridge that keeps look-alike lights apart costs some exactness; without it there is none to
    # lose.
    assert error.max() < bound


def test_lights_that_are_not_fitted_keep_their_radiance(scene: Scene):
    fitted = np.array([True, False, True, True, False, True])
    lights = LightParameters(fitted, np.where(fitted[:, None], 0.0, RADIANCE), False)
    photo, _ = scene.render(samples=8, seed=5)
    state = replace(scene.state, lights=np.zeros(lights.size))
    evaluation, term = evaluated(scene, lights, state, photo)
    found = initial_lights(evaluation, term, lights)
    np.testing.assert_array_equal(found[~fitted], RADIANCE[~fitted])
    assert np.abs(found - RADIANCE).max() / RADIANCE.max() < 0.08


def test_a_black_photo_gives_dim_lights_not_none(scene: Scene):
    evaluation, term = evaluated(scene, scene.lights, scene.state, np.zeros((96, 96, 3)))
    found = initial_lights(evaluation, term, scene.lights)
    assert np.isfinite(found).all() and (found > 0).all() and found.max() < 1e-3


def test_a_saturated_photo_gives_light_bright_enough(scene: Scene):
    """Every pixel says only "at least 1": so bright the model must be, and no light may
    collapse.
    """
    term = scene.photo_term(np.ones((96, 96, 3)), 8, clipped=np.ones((96, 96, 3), bool))
    evaluation = term.evaluate(replace(scene.state, lights=np.zeros(18)), 5)
    found = initial_lights(evaluation, term, scene.lights)
    image = evaluation.image
    shaded = scene.forward.shade(scene.state, image.surface, image.terms, radiance=found)
    assert np.median(shaded.color) > 0.8
