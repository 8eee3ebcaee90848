"""The vector of unknowns: layout, increments, bounds and light parameters."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.face.unknowns import BLOCKS
from reference.synthetic_scene import Scene, moved


def test_blocks_cover_the_vector_once(scene: Scene):
    layout = Layout(scene.state)
    masks = np.array([layout.mask((name,)) for name in BLOCKS])
    assert masks.shape[1] == layout.size
    np.testing.assert_array_equal(masks.sum(0), 1)
    np.testing.assert_array_equal(layout.mask(BLOCKS), True)


def test_no_step_changes_nothing(scene: Scene):
    layout = Layout(scene.state)
    same = layout.apply(scene.state, np.zeros(layout.size))
    np.testing.assert_array_equal(layout.values(same), layout.values(scene.state))
    np.testing.assert_array_equal(same.model_to_camera, scene.state.model_to_camera)
    assert same.camera == scene.state.camera


def test_a_step_adds_to_the_values(scene: Scene):
    layout = Layout(scene.state)
    step = np.random.default_rng(0).normal(size=layout.size) * 0.01
    after = layout.apply(scene.state, step)
    expected = layout.values(scene.state) + step
    expected[layout.slices["pose"]] = 0  # the pose is an increment, it always reads 0
    np.testing.assert_allclose(layout.values(after), expected, atol=1e-12)
    np.testing.assert_allclose(after.translation - scene.state.translation, step[3:6])


@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3))
def test_rotations_stay_rotations(scene: Scene, omega: list[float]):
    state = scene.state
    for _ in range(5):
        state = moved(state, pose=[*omega, 0, 0, 0])
    np.testing.assert_allclose(state.rotation @ state.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(state.rotation) == pytest.approx(1)
    np.testing.assert_allclose(
        moved(
            moved(scene.state, pose=[*omega, 0, 0, 0]), pose=[*(-np.array(omega)), 0, 0, 0]
        ).rotation,
        scene.state.rotation,
        atol=1e-12,
    )


@pytest.mark.parametrize("box", [True, False])
def test_bounds(scene: Scene, box: bool):
    layout = Layout(scene.state)
    low, high = layout.bounds(scene.known(expression_box=box))
    assert (low <= high).all()
    np.testing.assert_array_equal(low[layout.slices["lights"]], 0)
    np.testing.assert_array_equal(np.isinf(low[layout.slices["expression"]]), not box)
    values = layout.values(scene.state)
    assert ((values >= low) & (values <= high)).all()


def test_expressions_have_their_own_bounds(scene: Scene):
    layout = Layout(scene.state)
    low, high = layout.bounds(scene.known(expression_box=np.array([True, False, True])))
    np.testing.assert_array_equal(low[layout.slices["expression"]], [0, -np.inf, 0])
    np.testing.assert_array_equal(high[layout.slices["expression"]], [1, np.inf, 1])


@given(st.booleans(), st.integers(0, 2**16))
def test_radiance_round_trip_and_jacobian(uniform: bool, seed: int):
    random = np.random.default_rng(seed)
    count = int(random.integers(2, 8))
    fitted = random.random(count) > 0.4
    fitted[0] = True
    fixed = np.where(fitted[:, None], 0.0, random.random((count, 3)))
    lights = LightParameters(fitted, fixed, uniform)
    parameters = random.uniform(0.1, 2, lights.size)
    radiance = lights.radiance(parameters)
    np.testing.assert_array_equal(radiance[~fitted], fixed[~fitted])
    np.testing.assert_allclose(lights.radiance(lights.from_radiance(radiance)), radiance, rtol=1e-9)
    jacobian = lights.jacobian(parameters)
    for index in range(lights.size):
        step = np.zeros(lights.size)
        step[index] = 1e-6
        wanted = (lights.radiance(parameters + step) - lights.radiance(parameters - step))[
            fitted
        ] / 2e-6
        np.testing.assert_allclose(jacobian[:, :, index], wanted, atol=1e-8)


@given(st.integers(0, 2**16))
def test_uniform_lights_share_one_chromaticity(seed: int):
    random = np.random.default_rng(seed)
    lights = LightParameters(np.ones(5, bool), np.zeros((5, 3)), uniform=True)
    radiance = lights.radiance(lights.from_radiance(random.uniform(0.1, 5, (5, 3))))
    share = radiance / radiance.sum(1, keepdims=True)
    np.testing.assert_allclose(share, np.broadcast_to(share[0], share.shape), rtol=1e-12)


@pytest.mark.parametrize("uniform", [False, True])
def test_no_fitted_light_has_no_parameters_that_matter(uniform: bool):
    lights = LightParameters(np.zeros(3, bool), np.full((3, 3), 2.0), uniform)
    parameters = lights.from_radiance(np.full((3, 3), 2.0))
    assert parameters.shape == (lights.size,)
    np.testing.assert_array_equal(lights.radiance(parameters), 2.0)
