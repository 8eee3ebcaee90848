"""Standard deviations of vertices against drawn samples, and named directions against systems made
by hand.
"""

from __future__ import annotations

import numpy as np
import pytest

from facestage.fit.face.layout import Layout
from facestage.fit.given.metrics import aligned_difference
from facestage.fit.solve.covariance import Posterior, covariance
from facestage.fit.trust.directions import Unseen, find_null_directions
from facestage.fit.trust.vertex_certainty import vertex_deviation
from reference.synthetic_scene import Scene


def test_deviations_are_those_of_aligned_samples(scene: Scene):
    model, state, random = scene.model, scene.state, np.random.default_rng(1)
    relief = 5 * scene.geometry.relief_basis
    root = 0.05 * random.normal(size=(9, 9))
    region = model.regions["narrow_face"]
    mean = model.shape(state.identity, state.expression).astype(float)
    found = vertex_deviation(model, mean, state.rotation, root @ root.T, region, relief)
    bases = np.concatenate([model.identity_basis, model.expression_basis, relief]).astype(float)
    total, count = np.zeros((len(region), 3)), 2000
    for weights in random.normal(size=(count, 9)) @ root.T:
        sample = mean + np.tensordot(weights, bases, 1)
        aligned = aligned_difference(sample[region], mean[region], scale=True)
        total += (aligned @ state.rotation.T) ** 2
    drawn = 1e3 * np.sqrt(total / count)
    error = np.abs(found[region] - drawn).max() / drawn.max()
    print(
        f"largest deviation {drawn.max():.3f} mm, propagated and drawn differ by "
        f"{100 * error:.1f} %"
    )
    assert error < 0.06


def test_size_and_pose_drop_out(scene: Scene):
    model, state = scene.model, scene.state
    shape = model.shape(state.identity, state.expression).astype(float)
    basis = np.stack(
        [shape, np.broadcast_to([0.1, 0.2, 0.3], shape.shape), np.cross([0.3, 0.1, 0.2], shape)]
    )
    from dataclasses import replace

    moving = replace(
        model,
        identity_basis=basis.astype(np.float32),
        identity_names=("larger", "shift", "turn"),
        expression_basis=model.expression_basis[:0],
        expression_names=(),
    )
    found = vertex_deviation(
        moving, shape, np.eye(3), 0.01 * np.eye(3), model.regions["narrow_face"]
    )
    assert np.abs(found).max() < 1e-3, "mm"


def test_nothing_fitted_is_no_deviation(scene: Scene):
    shape = scene.model.shape(scene.state.identity, scene.state.expression)
    found = vertex_deviation(
        scene.model, shape, np.eye(3), np.zeros((7, 7)), scene.model.regions["narrow_face"]
    )
    assert found.shape == shape.shape and not found.any()


def test_the_inverse_leaves_out_what_is_frozen():
    matrix = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    found = covariance(matrix, np.array([True, True, True]))
    np.testing.assert_allclose(found[:2, :2], np.linalg.inv(matrix[:2, :2]), rtol=1e-9)
    assert np.isinf(found[2, 2])
    assert not covariance(matrix, np.array([False, True, False]))[0].any()


NAMES = {
    "identity": ["width", "height", "nose", "lean"],
    "expression": ["jaw_open", "smile", "brow_up"],
    "lights": [
        f"light {light} {color}" for light in range(6) for color in ("red", "green", "blue")
    ],
}


def system(scene: Scene) -> tuple[Layout, np.ndarray, np.ndarray]:
    """Layout, unit priors on all but the pose, and data that know everything well."""
    layout = Layout(scene.state)
    prior = np.eye(layout.size)
    pose = layout.slices["pose"]
    prior[pose, pose] = 0.0
    return layout, prior, 1e4 * np.eye(layout.size)


def sentences(scene: Scene, layout: Layout, prior: np.ndarray, data: np.ndarray) -> str:
    found = find_null_directions(
        Posterior(data + prior, prior, np.ones(layout.size, bool)),
        scene.state,
        scene.geometry,
        scene.lights,
        NAMES,
    )
    return "; ".join(found.sentences)


def test_with_good_data_nothing_is_open(scene: Scene):
    assert sentences(scene, *system(scene)) == ""


def test_twin_lights_dark_lights_and_hidden_modes_are_named(scene: Scene):
    layout, prior, data = system(scene)
    lights = layout.slices["lights"].start
    for channel in range(3):
        first, second, dark = (lights + 3 * light + channel for light in (1, 4, 5))
        data[first, second] = data[second, first] = 1e4
        data[dark, dark] = 0.0
    hidden = layout.slices["expression"].start + 1
    data[hidden, hidden] = 0.01
    found = sentences(scene, layout, prior, data)
    assert "only the sum is seen: 1 and 4" in found
    assert "reach nothing that is seen: 5" in found
    assert "hidden expressions: smile" in found and "identity" not in found
    unseen = Unseen(Posterior(data + prior, prior, np.ones(layout.size, bool)), layout)
    assert unseen.span.shape[1] == 3 + 3 + 1
    assert unseen.by_block() == pytest.approx({"lights": 6.0, "expression": 1.0}, abs=1e-6)


def test_trade_offs_are_named(scene: Scene):
    layout, prior, data = system(scene)
    # The image sees the product of skin brightness (every albedo mode) and light: only the sum of
    # their logarithms.
    joint = np.zeros(layout.size)
    joint[layout.slices["albedo"]] = scene.geometry.albedo_basis.mean(axis=(1, 2))
    joint /= np.linalg.norm(joint)
    light = np.zeros(layout.size)
    light[layout.slices["lights"]] = 1 / np.sqrt(18)
    data -= 1e4 * (np.outer(joint, joint) + np.outer(light, light))
    data += 1e4 * np.outer(joint + light, joint + light)
    assert "brightness of the skin" in sentences(scene, layout, prior, data)
    layout, prior, data = system(scene)
    depth, focal = layout.slices["pose"].start + 5, layout.slices["focal"].start
    data[depth, focal] = data[focal, depth] = -0.9999e4
    assert "focal length against distance" in sentences(scene, layout, prior, data)
