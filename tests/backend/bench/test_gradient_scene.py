"""Mitsuba's own scene shows what the fit's forward model shows, and its derivatives are right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

from facestage.bench.adam import SceneMap
from facestage.fit.face.layout import Layout
from facestage.render.gradient_scene import GradientScene, SceneValues, Target
from reference.synthetic_scene import Scene

PATHS = 128


@pytest.fixture(scope="module")
def values(scene: Scene) -> SceneValues:
    return SceneMap(scene.forward, Layout(scene.state), len(scene.state.specular)).values(
        scene.state
    )


@pytest.fixture(scope="module")
def mitsuba_scene(scene: Scene, values: SceneValues) -> GradientScene:
    return GradientScene(scene.geometry.triangles, scene.state.camera, scene.stage, values)


def test_both_renderers_agree(scene: Scene, values: SceneValues, mitsuba_scene: GradientScene):
    found = mitsuba_scene.render(values, PATHS, seed=1)
    expected, seen = scene.render(samples=64)
    inner = binary_erosion(seen, iterations=2)
    mean = np.abs(found[inner].mean(0) / expected[inner].mean(0) - 1).max()
    # A picture moved by a pixel would differ more: the frames, the principal point and the lens
    # agree.
    error = [
        np.sqrt(((np.roll(found, shift, (0, 1)) - expected)[inner] ** 2).mean())
        for shift in ((0, 0), (0, 1), (1, 0), (0, -1), (-1, 0))
    ]
    print(
        f"means differ by {mean:.4f} (allowed 0.01), RMS {error[0]:.4f}, moved by a pixel "
        f"{min(error[1:]):.4f}"
    )
    assert mean < 0.01
    assert error[0] < min(error[1:])


@pytest.mark.parametrize("what", ["radiance", "albedo", "c_spec", "roughness", "vertices"])
def test_derivatives_agree_with_finite_differences(
    scene: Scene, values: SceneValues, mitsuba_scene: GradientScene, what: str
):
    photo = 0.5 * scene.render(samples=16)[0]
    # Away from the silhouette, whose motion is not in the derivative by the vertices.
    inner = binary_erosion(scene.render(samples=1)[1], iterations=12 if what == "vertices" else 2)
    target = Target(photo, np.zeros(photo.shape, bool), inner.astype(float))
    direction = {
        "radiance": values.radiance,
        "albedo": values.albedo,
        "c_spec": values.c_spec,
        "roughness": np.array(1.0),
        "vertices": 0.01 * scene.geometry.basis[:, 1].reshape(-1, 3) @ scene.state.rotation.T,
    }[what]

    def loss(step: float) -> float:
        moved = replace(values, **{what: getattr(values, what) + step * direction})
        # Two independent renders: their product has no noise energy in it, like the derivative.
        one, two = (mitsuba_scene.render(moved, PATHS, seed) - photo for seed in (3, 4))
        return 0.5 * float((inner[..., None] * one * two).sum())

    step = {"vertices": 5.0, "roughness": 0.03}.get(what, 0.03)
    expected = (loss(step) - loss(-step)) / (2 * step)
    _, derivative = mitsuba_scene.gradient(values, target, PATHS, seed=3)
    found = float((getattr(derivative, what) * direction).sum())
    margin = abs(found - expected) / max(abs(expected), 1e-9)
    print(
        f"{what}: found {found:.4f}, expected {expected:.4f}, off by {100 * margin:.1f} % "
        "(allowed 12 %)"
    )
    assert margin < 0.12


def test_a_clipped_pixel_only_says_at_least(
    scene: Scene, values: SceneValues, mitsuba_scene: GradientScene
):
    photo, seen = scene.render(samples=16)
    weights = seen.astype(float)
    clipped = np.ones(photo.shape, bool)
    darker, _ = mitsuba_scene.gradient(values, Target(0.5 * photo, clipped, weights), 16, seed=1)
    brighter, _ = mitsuba_scene.gradient(values, Target(2.0 * photo, clipped, weights), 16, seed=1)
    plain, _ = mitsuba_scene.gradient(values, Target(0.5 * photo, ~clipped, weights), 16, seed=1)
    assert darker < 0.05 * plain
    assert brighter > plain
