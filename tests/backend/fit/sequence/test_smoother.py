"""The smoother against a dense one, and what it does to motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.motion import DEPTH, Motion, Triples, groups_of
from facestage.fit.sequence.smoother import DAMPING, Evidence, smooth
from reference.dense_smoother import bounded_minimum, dense_system

NAMES = ("jawOpen", "eyeBlink_L", "browInnerUp_L", "mouthSmile_L")
SIZE = POSE + len(NAMES)
LOW, HIGH = np.zeros(len(NAMES)), np.ones(len(NAMES))


def still(frames: int) -> Course:
    return Course(
        np.tile(np.eye(3), (frames, 1, 1)),
        np.tile([0.0, 0.0, -0.7], (frames, 1)),
        np.full((frames, len(NAMES)), 0.3),
    )


def motion_of(frames: int, shots: np.ndarray | None = None) -> Motion:
    shots = np.zeros(frames, int) if shots is None else shots
    return Motion.start(Triples.of(np.arange(frames) / 24, shots), groups_of(NAMES))


def random_evidence(frames: int, strength: float) -> Evidence:
    random = np.random.default_rng(frames)
    rows = random.normal(size=(frames, 30, SIZE)) * strength
    hessian = np.einsum("fri,frj->fij", rows, rows)
    return Evidence(hessian, random.normal(size=(frames, SIZE)) * strength**2 * 30)


@pytest.mark.parametrize("frames", [5, 8])
def test_the_step_is_the_bounded_minimum_of_the_dense_system(frames: int):
    course, evidence, motion = still(frames), random_evidence(frames, 3.0), motion_of(frames)
    motion = replace(motion, scales=np.full(SIZE, 0.2))
    found = smooth(course, evidence, motion, LOW, HIGH, rounds=0)
    damped = evidence.hessian.copy()
    each = np.arange(SIZE)
    damped[:, each, each] *= 1 + DAMPING
    matrix, slope = dense_system(
        damped, evidence.gradient, motion, motion.triples.differences(course)
    )
    low = np.full((frames, SIZE), -1e3)
    high = np.full((frames, SIZE), 1e3)
    low[:, POSE:], high[:, POSE:] = -course.expression, 1 - course.expression
    wanted = bounded_minimum(matrix, slope, low.ravel(), high.ravel()).reshape(frames, SIZE)
    step = np.concatenate(
        [
            found.course.translation - course.translation,
            found.course.expression - course.expression,
        ],
        axis=1,
    )
    weights = course.expression + wanted[:, POSE:]
    held = (weights <= 1e-9) | (weights >= 1 - 1e-9)
    assert held.any(), "a test of bounds wants some that hold"
    np.testing.assert_allclose(step, wanted[:, 3:], atol=2e-3)
    assert (found.deviation[:, POSE:][held] == 0).all()
    free = ~held.all(axis=1)
    inverse = np.linalg.inv(matrix)
    assert (found.deviation[free, :POSE] <= 1.01 * np.sqrt(np.diag(inverse).max())).all()


def noisy_depth(frames: int, noise: float) -> tuple[np.ndarray, np.ndarray, Evidence]:
    """True and measured depth of a head that nods slowly, as evidence around a head at rest."""
    random = np.random.default_rng(3)
    true = 0.01 * np.sin(np.arange(frames) / 12)
    seen = true + random.normal(size=frames) * noise
    hessian = np.zeros((frames, SIZE, SIZE))
    hessian[:, np.arange(SIZE), np.arange(SIZE)] = 1e4
    hessian[:, 5, 5] = 1 / noise**2
    gradient = np.zeros((frames, SIZE))
    gradient[:, 5] = -seen / noise**2
    return true, seen, Evidence(hessian, gradient)


def test_smoothness_is_learned_and_does_not_lag():
    frames, noise = 80, 1e-3
    true, seen, evidence = noisy_depth(frames, noise)
    found = smooth(still(frames), evidence, motion_of(frames), LOW, HIGH, rounds=40)
    depth = found.course.translation[:, 2] + 0.7
    error, before = np.std(depth - true), np.std(seen - true)
    assert error < 0.5 * before, f"{error:.2g} m left of {before:.2g} m"
    shifts = [np.std(np.roll(depth, shift)[4:-4] - true[4:-4]) for shift in (-1, 0, 1)]
    assert np.argmin(shifts) == 1
    scale = found.motion.scales[5]
    wanted = np.std(np.diff(true, 2))
    assert wanted / 4 < scale < 4 * wanted, f"scale {scale:.2g}, true {wanted:.2g}"
    deviation = found.deviation[:, 5]
    assert 0.5 < error / deviation.mean() < 2


def test_a_blink_passes_though_the_rest_is_smoothed():
    frames, noise = 60, 0.05
    true = np.zeros(frames)
    true[28:33] = [0.35, 0.85, 1.0, 0.85, 0.35]
    seen = np.clip(true + np.random.default_rng(0).normal(size=frames) * noise, 0, 1)
    course = replace(still(frames), expression=np.zeros((frames, len(NAMES))))
    hessian = np.zeros((frames, SIZE, SIZE))
    hessian[:, np.arange(SIZE), np.arange(SIZE)] = 1e4
    hessian[:, 7, 7] = 1 / noise**2
    gradient = np.zeros((frames, SIZE))
    gradient[:, 7] = -seen / noise**2
    found = smooth(course, Evidence(hessian, gradient), motion_of(frames), LOW, HIGH, rounds=30)
    blink = found.course.expression[:, 1]
    assert blink[30] > 0.9
    assert np.abs(blink - true)[:20].max() < np.abs(seen - true)[:20].max()


def test_a_cut_is_not_smoothed_over():
    frames = 20
    shots = np.where(np.arange(frames) < 10, 1, 2)
    _, _, evidence = noisy_depth(frames, 1e-3)
    jump = np.where(shots == 2, 0.05, 0.0)
    evidence.gradient[:, 5] = -jump / 1e-6
    found = smooth(still(frames), evidence, motion_of(frames, shots), LOW, HIGH, rounds=10)
    np.testing.assert_allclose(found.course.translation[:, 2] + 0.7, jump, atol=2e-4)


def test_a_frame_that_says_nothing_lies_between_its_neighbours():
    frames = 15
    _, _, evidence = noisy_depth(frames, 1e-4)
    ramp = 0.001 * np.arange(frames)
    evidence.gradient[:, 5] = -ramp / 1e-8
    evidence.hessian[7], evidence.gradient[7] = 0, 0
    found = smooth(still(frames), evidence, motion_of(frames), LOW, HIGH, rounds=0)
    assert abs(found.course.translation[7, 2] + 0.7 - ramp[7]) < 1e-4
    assert found.deviation[7, 5] > 2 * found.deviation[6, 5]
    assert motion_of(frames).groups[5] == DEPTH
