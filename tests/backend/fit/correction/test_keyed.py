"""What keys say of the frames beside them, on made-up films whose errors are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.fit.correction.keyed import Keyed, Keys
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.motion import Motion, Triples, groups_of
from facestage.fit.sequence.smoother import Evidence

NAMES = ("jawOpen", "mouthClose", "eyeBlink_L")
FRAMES, SIZE = 41, POSE + len(NAMES)
MIDDLE = FRAMES // 2
LOW, HIGH = np.zeros(len(NAMES)), np.ones(len(NAMES))
HELD = np.isin(np.arange(FRAMES), [0, 1, FRAMES - 2, FRAMES - 1])
EVERY = np.arange(SIZE)


@pytest.fixture
def found() -> Course:
    """A head that turns and talks, as a film has it."""
    phase = np.linspace(0, 2 * np.pi, FRAMES)
    turns = np.outer(0.2 * np.sin(phase), [0, 1, 0])
    weights = 0.4 + 0.2 * np.sin(phase)[:, None] * [1.0, 0.5, 0.0]
    rotation = Rotation.from_rotvec(turns).as_matrix()
    return Course(rotation, np.tile([0.0, 0.0, -0.7], (FRAMES, 1)), weights)


@pytest.fixture
def motion() -> Motion:
    """Of slow weights."""
    triples = Triples.of(np.arange(FRAMES) / 24, np.zeros(FRAMES, int))
    start = Motion.start(triples, groups_of(NAMES))
    return replace(start, scales=np.array([0.002] * 3 + [1e-4] * 3 + [0.008, 0.008, 0.03]))


def keyed(found: Course, motion: Motion, values: dict[tuple[int, int], float]) -> Keyed:
    """At keys of (frame, weight)."""
    known = np.zeros((FRAMES, SIZE), bool)
    weights = found.expression.copy()
    for (frame, weight), value in values.items():
        known[frame, POSE + weight], weights[frame, weight] = True, value
    keys = Keys(known, weights, found.rotation.copy(), found.translation.copy())
    return Keyed.begin(found, motion, keys, HELD)


def after_looks(began: Keyed, found: Course, hessian: np.ndarray) -> Keyed:
    """By a film that sees the faces of ``found``, wherever they are."""
    none = Evidence(np.zeros((FRAMES, SIZE, SIZE)), np.zeros((FRAMES, SIZE)))
    result = began
    for _ in range(3):
        seen = result.seen
        turn = (
            Rotation.from_matrix(seen.rotation) * Rotation.from_matrix(found.rotation).inv()
        ).as_rotvec()
        off = np.concatenate(
            [turn, seen.translation - found.translation, seen.expression - found.expression], axis=1
        )
        said = Evidence(hessian, np.einsum("fij,fj->fi", hessian, off))
        result = result.improved(said, none, LOW, HIGH)
    return result


def sure(strength: float = 1e6) -> np.ndarray:
    """A film that is as sure of everything."""
    return np.tile(strength * np.eye(SIZE), (FRAMES, 1, 1))


def test_a_key_takes_its_neighbours_along_and_nothing_far_away(found: Course, motion: Motion):
    value = found.expression[MIDDLE, 0] - 0.2
    after = after_looks(keyed(found, motion, {(MIDDLE, 0): value}), found, sure())
    change = (after.course.expression - found.expression)[:, 0]
    np.testing.assert_allclose(change[MIDDLE], -0.2, atol=1e-5)
    # However sure the film is of itself.
    assert change[MIDDLE + 1] < -0.17 and change[MIDDLE - 3] < -0.08
    np.testing.assert_allclose(change, change[::-1], atol=2e-3)
    assert np.abs(change[[2, 3, -3, -4]]).max() < 0.02
    np.testing.assert_array_equal(after.course.expression[HELD], found.expression[HELD])
    # No spike, whose second difference would be 0.4.
    steps = np.abs(np.diff(change, 2))
    assert steps.max() < 0.06
    # What was not corrected stays: the film has it right.
    np.testing.assert_allclose(after.course.expression[:, 1:], found.expression[:, 1:], atol=1e-4)
    np.testing.assert_allclose(after.course.translation, found.translation, atol=1e-6)


def test_what_moves_fast_is_corrected_for_a_shorter_time(found: Course, motion: Motion):
    changes = []
    for weight in (0, 2):
        value = found.expression[MIDDLE, weight] + 0.2
        after = after_looks(keyed(found, motion, {(MIDDLE, weight): value}), found, sure())
        changes.append((after.course.expression - found.expression)[:, weight])
    slow, fast = np.abs(changes)[:, MIDDLE + 4]
    assert fast < 0.75 * slow


def test_a_key_where_the_film_had_it_changes_nothing(found: Course, motion: Motion):
    value = found.expression[MIDDLE, 0]
    after = after_looks(keyed(found, motion, {(MIDDLE, 0): value}), found, sure())
    np.testing.assert_allclose(after.course.expression, found.expression, atol=1e-7)
    np.testing.assert_allclose(after.course.rotation, found.rotation, atol=1e-7)


def test_what_the_film_cannot_tell_apart_makes_room(found: Course, motion: Motion):
    """Jaw and lips: the film sees how far the mouth is open, and hardly which of them does it."""
    hessian = np.tile(np.eye(SIZE), (FRAMES, 1, 1))
    both = np.zeros(SIZE)
    both[[POSE, POSE + 1]] = 1.0, -1.0
    hessian += 1e6 * np.outer(both, both)
    value = found.expression[MIDDLE, 0] + 0.2
    after = after_looks(keyed(found, motion, {(MIDDLE, 0): value}), found, hessian)
    change = (after.course.expression - found.expression)[MIDDLE]
    assert change[0] == pytest.approx(0.2, abs=1e-4)
    assert change[1] > 0.1


def test_several_keys_are_all_met_and_beyond_the_usual_range(found: Course, motion: Motion):
    keys = {(MIDDLE - 4, 0): 0.1, (MIDDLE, 0): 0.9, (MIDDLE + 1, 2): 0.0}
    began = keyed(found, motion, keys)
    course = after_looks(began, found, sure()).course
    for (frame, weight), value in keys.items():
        assert course.expression[frame, weight] == pytest.approx(value, abs=1e-4)
    exact = began.keys.put_into(course)
    for (frame, weight), value in keys.items():
        assert exact.expression[frame, weight] == value
    free = np.ones(exact.expression.shape, bool)
    free[tuple(np.array(list(keys)).T)] = False
    np.testing.assert_array_equal(exact.expression[free], course.expression[free])


def test_a_pose_is_a_key_as_a_weight_is(found: Course, motion: Motion):
    known = np.zeros((FRAMES, SIZE), bool)
    known[MIDDLE, :POSE] = True
    rotation, translation = found.rotation.copy(), found.translation.copy()
    turn = Rotation.from_rotvec([0.0, 0.1, 0.0]).as_matrix()
    rotation[MIDDLE] = turn @ rotation[MIDDLE]
    translation[MIDDLE] += [0.01, 0.0, 0.02]
    keys = Keys(known, found.expression.copy(), rotation, translation)
    after = after_looks(Keyed.begin(found, motion, keys, HELD), found, sure(1e8))
    course = after.course
    np.testing.assert_allclose(course.rotation[MIDDLE], rotation[MIDDLE], atol=1e-5)
    np.testing.assert_allclose(course.translation[MIDDLE], translation[MIDDLE], atol=1e-5)
    beside = course.translation[MIDDLE + 1] - found.translation[MIDDLE + 1]
    assert beside[0] > 0.007 and beside[2] > 0.014
    np.testing.assert_array_equal(course.rotation[HELD], found.rotation[HELD])
    assert np.abs(course.expression - found.expression).max() < 1e-4
    put = keys.put_into(course)
    np.testing.assert_array_equal(put.translation[MIDDLE], translation[MIDDLE])
    np.testing.assert_array_equal(put.rotation[MIDDLE + 1], course.rotation[MIDDLE + 1])
