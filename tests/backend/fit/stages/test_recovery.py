"""Known parameters come back from synthetic photos: each kind alone, and all jointly.

The photo has 64 light samples of other random numbers than the fit's 16, so a perfect answer is not
on offer.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.contract.job import Weights
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import BLOCKS
from facestage.fit.given.metrics import aligned_distance, psnr
from reference.known import known
from reference.synthetic_scene import Scene, moved

# The photo alone must do it: landmarks and priors are all but off.
PHOTO_ONLY = Weights(prior=1e-3, light=1e-3, landmarks=1e-3)
START_LIGHT = np.full((6, 3), 3.0)
SHIFT = [0.06, -0.08, 0.05, 0.006, -0.005, 0.03]


@pytest.fixture(scope="module")
def photo(scene: Scene) -> np.ndarray:
    return scene.render(samples=64)[0]


def recover(scene: Scene, photo: np.ndarray, blocks: tuple[str, ...], start: State) -> State:
    return scene.fit(scene.solver(photo, blocks, 12, PHOTO_ONLY, samples=16), start)[0]


def report(name: str, error: float, allowed: float) -> None:
    print(f"{name}: error {error:.3g}, allowed {allowed:g}, margin {allowed / error:.1f}x")
    assert error < allowed


def test_lights_alone(scene: Scene, photo: np.ndarray):
    found = recover(
        scene,
        photo,
        ("lights",),
        replace(scene.state, lights=scene.lights.from_radiance(START_LIGHT)),
    )
    report(
        "lights, share of the brightest", np.abs(found.lights - scene.state.lights).max() / 9, 0.02
    )


def test_lights_of_one_color_alone(uniform_scene: Scene):
    photo = uniform_scene.render(samples=64)[0]
    start = replace(uniform_scene.state, lights=uniform_scene.lights.from_radiance(START_LIGHT))
    found = recover(uniform_scene, photo, ("lights",), start)
    wanted, radiance = (
        uniform_scene.lights.radiance(state.lights) for state in (uniform_scene.state, found)
    )
    report(
        "lights of one color, share of the brightest",
        np.abs(radiance - wanted).max() / wanted.max(),
        0.02,
    )
    share = radiance / radiance.sum(1, keepdims=True)
    np.testing.assert_allclose(share, np.broadcast_to(share[0], share.shape), rtol=1e-9)


def test_albedo_alone(scene: Scene, photo: np.ndarray):
    found = recover(scene, photo, ("albedo",), replace(scene.state, albedo=np.zeros(5)))
    report("albedo coefficients", np.abs(found.albedo - scene.state.albedo).max(), 0.02)


def test_pose_alone(scene: Scene, photo: np.ndarray):
    found = recover(scene, photo, ("pose",), moved(scene.state, pose=SHIFT))
    turn = Rotation.from_matrix(found.rotation @ scene.state.rotation.T).magnitude()
    report("rotation, degrees", float(np.degrees(turn)), 0.3)
    report(
        "translation, mm",
        1e3 * float(np.linalg.norm(found.translation - scene.state.translation)),
        0.3,
    )


def test_expression_alone(scene: Scene, photo: np.ndarray):
    found = recover(
        scene, photo, ("expression",), replace(scene.state, expression=np.full(3, 0.05))
    )
    report("expression weights", np.abs(found.expression - scene.state.expression).max(), 0.06)


def test_identity_alone(scene: Scene, photo: np.ndarray):
    found = recover(scene, photo, ("identity",), replace(scene.state, identity=np.zeros(4)))
    report("identity coefficients", np.abs(found.identity - scene.state.identity).max(), 0.05)


def test_roughness_alone(scene: Scene, photo: np.ndarray):
    found = recover(scene, photo, ("roughness",), replace(scene.state, roughness=0.3))
    report("roughness", abs(found.roughness - scene.state.roughness), 0.02)


def test_light_position_alone(scene: Scene, photo: np.ndarray):
    """Lights that stand 6 degrees from where they shone are found, shadows and highlights following
    them.
    """
    away = np.radians(6.0) * np.array([[1, 0], [0, 1], [-1, 0], [0, -1], [1, 1], [-1, 1]])
    found = recover(scene, photo, ("light_position",), replace(scene.state, light_position=away))
    flux = scene.state.lights.reshape(-1, 3).mean(axis=1)
    error = np.degrees(np.linalg.norm(found.light_position, axis=1))
    report("strongest light's place, degrees", float(error[flux.argmax()]), 2.0)


def test_specular_map_alone(scene: Scene, photo: np.ndarray):
    found = recover(
        scene, photo, ("specular",), replace(scene.state, specular=np.full((6, 6), 0.4))
    )
    # Texels without a highlight say nothing; those on the face's middle do.
    middle = np.s_[1:5, 1:5]
    report(
        "specular, middle of the map",
        np.abs(found.specular - scene.state.specular)[middle].mean(),
        0.12,
    )


def start_of_all(scene: Scene) -> State:
    start = moved(scene.state, pose=0.5 * np.array(SHIFT))
    return replace(
        start,
        identity=np.zeros(4),
        expression=np.full(3, 0.05),
        albedo=np.zeros(5),
        roughness=0.4,
        lights=scene.lights.from_radiance(START_LIGHT),
        specular=np.full((6, 6), 0.8),
    )


def test_all_jointly(scene: Scene, photo: np.ndarray):
    """With half a pixel of landmark noise: depth x size and albedo x light stay nearly free, the
    face does not.
    """
    weights = Weights(prior=0.02, light=0.02)
    blocks = tuple(name for name in BLOCKS if name not in ("focal", "light_position"))
    stage = scene.solver(
        photo, blocks, 25, weights, samples=16, landmarks=scene.landmarks(noise_px=0.5)
    )
    start = start_of_all(scene)
    found, steps = scene.fit(stage, start)
    truth, seen = scene.forward.pose(scene.state)[1], scene.render()[1]
    errors = [
        1e3 * aligned_distance(scene.forward.pose(state)[1], truth, True).mean()
        for state in (start, found)
    ]
    quality = psnr(scene.render(found)[0] / photo.max(), photo / photo.max(), seen)
    print(f"jointly in {len(steps)} steps: {errors[0]:.2f} mm at the start")
    report("jointly, similarity-aligned mm", errors[1], 0.6)
    report("jointly, dB short of 60", 60 - quality, 30)
    radiance = found.lights.reshape(-1, 3)
    relative = (
        radiance / radiance.sum() - scene.state.lights.reshape(-1, 3) / scene.state.lights.sum()
    )
    report("jointly, share of each light", np.abs(relative).max(), 0.02)
    report(
        "jointly, expression weights", np.abs(found.expression - scene.state.expression).max(), 0.1
    )


def test_every_accepted_step_lowers_the_energy_under_the_weights_it_was_made_with(
    scene: Scene, photo: np.ndarray
):
    stage = scene.solver(photo, BLOCKS, 10, Weights(), landmarks=scene.landmarks(noise_px=0.5))
    start = start_of_all(scene)
    _, steps = scene.fit(stage, start)
    assert len(steps) >= 3
    active = np.ones(stage.energy.layout.size, bool)
    state, evaluation = start, known(stage.energy.evaluate(start, 3))
    for step in steps:
        system = stage.energy.at(state, evaluation).system(state, active)
        decrease = system.decrease(step.state, step.evaluation)
        assert decrease > 0
        state, evaluation = step.state, known(step.evaluation)
    first, last = (
        float((known(item.evaluation).residual ** 2).mean()) for item in (steps[0], steps[-1])
    )
    assert last < first


def test_clipped_pixels_say_at_least_this_bright(scene: Scene, photo: np.ndarray):
    """A photo clipped at its middle still gives the lights; taking the clip for truth does not."""
    level = float(np.percentile(photo[photo > 0], 60))
    clipped, cut = photo >= level, np.minimum(photo, level)
    start = replace(scene.state, lights=scene.lights.from_radiance(START_LIGHT))
    errors = []
    for mask in (clipped, None):
        stage = scene.solver(cut, ("lights",), 15, PHOTO_ONLY, samples=16, clipped=mask)
        found = scene.fit(stage, start)[0]
        errors.append(
            float(np.abs(found.lights - scene.state.lights).mean() / scene.state.lights.mean())
        )
    print(
        f"clipped pixels one-sided: lights off by {100 * errors[0]:.0f} %; taken for truth: "
        f"{100 * errors[1]:.0f} %"
    )
    assert errors[0] < 0.75 * errors[1]


def test_frozen_entries_do_not_move(scene: Scene, photo: np.ndarray):
    stage = scene.solver(photo, BLOCKS, 4, Weights())
    layout = stage.energy.layout
    held = np.random.default_rng(0).random(layout.size) < 0.5
    held[layout.slices["pose"]] = True
    start = start_of_all(scene)
    stage.freeze = held
    found, steps = scene.fit(stage, start)
    assert steps
    before, after = layout.values(start), layout.values(found)
    np.testing.assert_array_equal(before[held], after[held])
    np.testing.assert_array_equal(found.model_to_camera, start.model_to_camera)
    assert (before[~held] != after[~held]).mean() > 0.5


def test_light_linearity(scene: Scene):
    """The picture of all lights is the sum of the pictures of one light each, to float32."""
    joint = scene.render(samples=8)[0]
    total = np.zeros_like(joint)
    for light in range(len(scene.stage)):
        only = np.zeros((6, 3))
        only[light] = scene.lights.radiance(scene.state.lights)[light]
        total += scene.render(
            replace(scene.state, lights=scene.lights.from_radiance(only)), samples=8
        )[0]
    error = np.abs(total - joint).max() / joint.max()
    print(f"sum of one-light pictures against the joint one: {error:.1e}")
    assert error < 1e-6
