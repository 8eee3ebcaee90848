"""Pose and sliders from points: derivatives, known truth, bounds, and the backend's own stage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.contract.camera import Camera
from facestage_blender.pins.solver import (
    Guess,
    Shapes,
    Sight,
    energy,
    jacobian,
    positions,
    residuals,
    rotation,
    solve,
    upright_pose,
)

CAMERA = Camera(640, 480, 700.0, (318.0, 243.0))
MODES = 6


def face(scale: float = 1.0) -> Shapes:
    """A shell of 60 points in the mesh's own unit, four modes to both sides and two from 0 to 1."""
    random = np.random.default_rng(0)
    rest = random.uniform(-1, 1, (60, 3)) * [0.08, 0.1, 0.02]
    rest[:, 2] += 0.06 - 5.0 * (rest[:, :2] ** 2).sum(axis=1)
    modes = 0.004 * random.normal(size=(60, 3, MODES))
    low, high = np.array([-5.0] * 4 + [0.0] * 2), np.array([5.0] * 4 + [1.0] * 2)
    return Shapes(rest / scale, modes / scale, np.array([1.0] * 4 + [0.35] * 2), low, high)


def pose(scale: float = 1.0) -> np.ndarray:
    result = np.eye(4)
    result[:3, :3] = scale * rotation(np.array([0.15, -0.3, 0.1]))
    result[:3, 3] = 0.02, -0.01, -0.8
    return result


def truth(scale: float = 1.0) -> Guess:
    return Guess(pose(scale), np.array([1.2, -0.7, 0.4, 2.0, 0.6, 0.0]))


def sight_of(
    shapes: Shapes, guess: Guess, deviation: float = 0.01, sure: bool = True, focal: float = 0.0
) -> Sight:
    count = len(shapes.rest)
    pixels = CAMERA.project(positions(shapes, guess))
    one = np.ones(count)
    return Sight(CAMERA, pixels, deviation * one, one, np.full(count, sure), focal)


@pytest.mark.parametrize("focal", [0.0, 0.25])
def test_jacobian_equals_finite_differences(focal: float):
    shapes, guess, centre = face(), truth(), np.array([0.0, 0.0, -0.78])
    sight = sight_of(shapes, guess, focal=focal)
    guess, unknowns = replace(guess, focal_px=810.0), 6 + MODES + bool(focal)
    found, step = jacobian(shapes, sight, guess, centre), 1e-6
    assert found.shape[2] == unknowns
    for column in range(unknowns):
        by = np.zeros(unknowns)
        by[column] = step
        plus, minus = (
            residuals(shapes, sight, guess.turned(sign * by, centre)) for sign in (1, -1)
        )
        wanted = (plus - minus) / (2 * step)
        error = np.abs(found[..., column] - wanted).max() / np.abs(wanted).max()
        print(f"{column}: {error:.1e}")
        assert error < 1e-6


@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_pins_of_a_known_face_recover_it(scale: float):
    """Also of a mesh in centimetres, from a pose found in closed form."""
    shapes, wanted, rest = face(scale), truth(scale), np.zeros(MODES)
    sight = sight_of(shapes, wanted, deviation=1e-3)
    start = Guess(upright_pose(shapes.rest, sight, np.full(3, scale)), rest)
    first = energy(shapes, sight, start, rest)
    found = solve(shapes, sight, start, rest)
    away = CAMERA.project(positions(shapes, found)) - sight.pixels
    print(f"energy {first:.3g} to {energy(shapes, sight, found, rest):.3g}")
    assert np.abs(away).max() < 1e-2
    np.testing.assert_allclose(found.sliders, wanted.sliders, atol=0.02)
    np.testing.assert_allclose(found.to_camera, wanted.to_camera, atol=2e-3)


@pytest.mark.parametrize("wrong", [0.6, 1.0, 1.8])
def test_pins_of_a_known_face_recover_the_focal_length(wrong: float):
    """From a camera that has another one; where that is known, it stays, and the face is off."""
    shapes, wanted, rest = face(), truth(), np.zeros(MODES)
    sight = sight_of(shapes, wanted, deviation=1e-3)
    for sigma in (0.25, 0.0):
        guessed = replace(CAMERA, focal_px=wrong * CAMERA.focal_px)
        sight = replace(sight, camera=guessed, focal_sigma=sigma)
        start = Guess(upright_pose(shapes.rest, sight, np.ones(3)), rest)
        found = solve(shapes, sight, start, rest)
        focal = sight.lens(found).focal_px
        if sigma:
            away = sight.lens(found).project(positions(shapes, found)) - sight.pixels
            print(f"{guessed.focal_px:.0f} px to {focal:.2f}, true 700; {np.abs(away).max():.4f}")
            assert np.abs(away).max() < 1e-2
            assert focal == pytest.approx(CAMERA.focal_px, rel=0.01)
            np.testing.assert_allclose(found.to_camera, wanted.to_camera, atol=1e-2)
        else:
            assert focal == guessed.focal_px


def test_the_answer_is_a_minimum_within_the_bounds():
    shapes, rest = face(), np.zeros(MODES)
    beyond = replace(truth(), sliders=np.array([0.5, 0.0, 0.0, 0.0, 1.6, -0.4]))
    sight = sight_of(shapes, beyond, deviation=0.5)
    found = solve(shapes, sight, Guess(pose(), rest), rest)
    assert found.sliders[4] == 1.0 and found.sliders[5] == 0.0
    value, centre = energy(shapes, sight, found, rest), positions(shapes, found).mean(axis=0)
    random = np.random.default_rng(1)
    for _ in range(100):
        step = 1e-3 * random.normal(size=6 + MODES) * ([1e-2] * 6 + [1.0] * MODES)
        other = found.turned(step, centre)
        other = replace(other, sliders=np.clip(other.sliders, shapes.low, shapes.high))
        assert energy(shapes, sight, other, rest) > value


def test_one_wrong_landmark_weighs_little_and_one_wrong_pin_counts():
    shapes, wanted, rest = face(), truth(), np.zeros(MODES)
    off = {}
    for sure in (False, True):
        sight = sight_of(shapes, wanted, deviation=1.0, sure=False)
        sight.pixels[7] += [60.0, 0.0]
        sight.sure[7] = sure
        found = solve(shapes, sight, wanted, rest)
        off[sure] = np.abs(CAMERA.project(positions(shapes, found)) - sight.pixels)[7, 0]
    print(off)
    assert off[False] > 55.0
    assert off[True] < 45.0


def test_what_nothing_holds_stays():
    shapes, start = face(), truth()
    sight = replace(sight_of(shapes, start), deviation=np.full(len(shapes.rest), np.inf))
    found = solve(shapes, sight, start, start.sliders)
    np.testing.assert_allclose(found.to_camera, start.to_camera, atol=1e-9)
    np.testing.assert_allclose(found.sliders, start.sliders, atol=1e-9)


def test_a_face_behind_the_camera_has_no_energy():
    shapes, guess = face(), truth()
    sight = sight_of(shapes, guess)
    behind = guess.turned(np.r_[0, 0, 0, 0, 0, 2.0, np.zeros(MODES)], np.zeros(3))
    assert energy(shapes, sight, behind, guess.sliders) == np.inf
