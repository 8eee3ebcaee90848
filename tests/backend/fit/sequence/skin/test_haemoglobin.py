"""Haemoglobin that comes and goes in rendered frames, and what noise makes of none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.forward.shading import ForwardModel
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.frames import Cut
from facestage.fit.sequence.skin.haemoglobin import Haemoglobin, haemoglobin
from facestage.fit.sequence.skin.leftover import SKIN_PX, left_over
from facestage.fit.sequence.skin.patches import Patches, PatchSeen
from facestage.images.image_io import Photograph
from facestage.models.anatomy.skin import pigment_directions
from facestage.render.variant import start_renderer
from reference.synthetic_scene import Scene, synthetic_scene

FRAMES, PATCHES = 48, 60
TIMES, SHOTS = np.arange(FRAMES) / 24, np.ones(FRAMES, int)
COLOR = pigment_directions()[1]


@pytest.fixture(scope="module")
def scene() -> Scene:
    start_renderer("cpu")
    return synthetic_scene(side=72)


@pytest.fixture(scope="module")
def patches(scene: Scene) -> Patches:
    return Patches.of(scene.geometry, PATCHES)


def smooth_field(geometry: FaceGeometry) -> np.ndarray:
    """(vertices,) more on one side of the face."""
    x = geometry.mean[:, 0]
    return np.asarray(0.5 + (x - x.mean()) / np.ptp(x))


Film = Callable[..., tuple[list[PatchSeen | None], np.ndarray]]


@pytest.fixture
def film(patches: Patches) -> Film:
    """Makes what 48 frames say, and the truth (frames, patches): a texture that is wrong, shading
    and highlights that are wrong from frame to frame, and haemoglobin ``change`` (frames,) of a
    smooth field.
    """

    def make(geometry: FaceGeometry, change: np.ndarray, seed: int = 0):
        rng = np.random.default_rng(seed)
        field = patches.means(smooth_field(geometry)[None])[:, 0]
        truth = change[:, None] * field
        texture = 0.05 * rng.normal(size=(PATCHES, 3))
        frames: list[PatchSeen | None] = []
        for row in truth:
            gain = rng.uniform(0.7, 1.0, (PATCHES, 3))
            shading = 0.05 * rng.normal(size=(PATCHES, 1)) * np.array([1.0, 1.03, 1.05])
            noise = 0.004 * rng.normal(size=(PATCHES, 3))
            residual = texture + gain * row[:, None] * COLOR + shading + noise
            frames.append(PatchSeen(np.full(PATCHES, 80.0), residual, gain))
        return frames, truth

    return make


def field_of(found: Haemoglobin, geometry: FaceGeometry, patches: Patches) -> np.ndarray:
    return found.coefficients @ patches.means(found.harmonics[:, geometry.used]).T


BLUSH = 2.0 / (1.0 + np.exp(-(np.arange(FRAMES) - 20) / 3.0))


def test_a_blush_is_found_past_shading_that_is_wrong(
    scene: Scene, patches: Patches, film: Film
) -> None:
    frames, truth = film(scene.geometry, BLUSH)
    found = haemoglobin(scene.geometry, patches, frames, TIMES, SHOTS, (0, 1))
    truth = truth - truth[:2].mean(axis=0)
    error = field_of(found, scene.geometry, patches) - truth
    assert np.sqrt((error**2).mean()) < 0.2 < 0.6 < np.sqrt((truth**2).mean())
    assert found.is_clear and 0.6 < found.change <= 1.1 * truth.std(axis=0).max()
    np.testing.assert_allclose(found.coefficients[:2].mean(axis=0), 0.0, atol=1e-12)
    assert found.harmonics.shape == (12, len(scene.model.vertices))


def test_deviations_say_how_far_off_it_is(scene: Scene, patches: Patches, film: Film) -> None:
    frames, _ = film(scene.geometry, 0.0 * BLUSH, seed=1)
    found = haemoglobin(scene.geometry, patches, frames, TIMES, SHOTS, range(FRAMES))
    within = np.abs(found.coefficients) < 2 * found.deviation
    # The largest mixtures of noise are shown, so more of them lie outside than of any.
    assert within.mean() > 0.75
    assert found.deviation.max() < 0.5
    assert not found.is_clear and found.change < 0.2


def test_frames_without_a_face_follow_their_neighbours_and_say_so(
    scene: Scene, patches: Patches, film: Film
) -> None:
    frames, truth = film(scene.geometry, BLUSH)
    frames[24:30] = [None] * 6
    found = haemoglobin(scene.geometry, patches, frames, TIMES, SHOTS, (0, 1))
    field = field_of(found, scene.geometry, patches)
    assert np.abs(field - truth + truth[:2].mean(axis=0))[24:30].mean() < 0.25
    assert (found.deviation[27] > 1.5 * found.deviation[10]).all()


def test_nothing_is_carried_over_a_cut(scene: Scene, patches: Patches, film: Film) -> None:
    step = np.where(np.arange(FRAMES) < 24, 0.0, 1.5)
    frames, truth = film(scene.geometry, step)
    shots = 1 + (np.arange(FRAMES) >= 24).astype(int)
    errors = []
    for each in (shots, SHOTS):
        # Of 1,000 frames a second, between which little changes otherwise.
        found = haemoglobin(scene.geometry, patches, frames, TIMES * 0.024, each, (0,))
        field = field_of(found, scene.geometry, patches)
        error = (field - truth + truth[0]).mean(axis=1)
        errors.append(np.abs(error[22:26]).mean())
    assert errors[0] < 0.5 * errors[1]


def test_what_a_frame_has_left_over_is_the_albedo_that_changed(
    scene: Scene, patches: Patches
) -> None:
    actor = Actor(scene.geometry, scene.forward, scene.stage, np.eye(4), scene.state)
    model, landmarks = scene.model, scene.landmarks()
    field = np.zeros(len(model.vertices))
    field[scene.geometry.used] = smooth_field(scene.geometry)
    redder = replace(
        model, albedo_mean=(model.albedo_mean * np.exp(field[:, None] * COLOR)).astype(np.float32)
    )
    geometry = FaceGeometry(redder, scene.geometry.relief_basis)
    changed = replace(scene, geometry=geometry, forward=ForwardModel(geometry, scene.lights))
    said = []
    for each in (scene, changed):
        color = each.render(samples=64)[0].astype(np.float32)
        mask, clipped = np.ones(color.shape[:2], bool), np.zeros(color.shape, bool)
        cut = Cut.of(Photograph(color, mask, clipped), landmarks, SKIN_PX)
        said.append(patches.seen(left_over(actor, cut, scene.state)))
    seen = (said[0].weight > 5) & (said[1].weight > 5)
    assert seen.sum() > 20
    change = (said[1].residual - said[0].residual)[seen]
    wanted = said[1].by_log_albedo * patches.means(smooth_field(scene.geometry)[None]) * COLOR
    np.testing.assert_allclose(change, wanted[seen], atol=6e-3)
    assert np.abs(wanted[seen]).max() > 0.06
