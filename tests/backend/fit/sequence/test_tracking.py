"""What pictures under one light, and under light that moves, say of a whole film."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from facestage.contract.files.partial import SEQUENCE_CHECKPOINT
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.landmarks import Landmarks
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.checkpoint import PassCheckpoint
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.frames import FrameView, landmark_evidence
from facestage.fit.sequence.landmark_bias import LandmarkBias
from facestage.fit.sequence.motion import LIDS, Motion, Triples, groups_of
from facestage.fit.sequence.tracking import ALIKE, BESIDE_PICTURE, Tracked, Tracker, honest
from facestage.images.film import Frame
from facestage.images.image_io import Photograph
from facestage.render.variant import start_renderer
from reference.synthetic_scene import Scene, synthetic_scene

FRAMES = 7


@pytest.fixture(scope="module")
def scene() -> Scene:
    start_renderer("cpu")
    return synthetic_scene(side=72)


@pytest.fixture(scope="module")
def course(scene: Scene) -> Course:
    """A head that turns a little while its jaw opens."""
    turns = [Rotation.from_rotvec([0.0, 0.1 * np.cos(t), 0.0]) for t in np.arange(FRAMES)]
    expression = np.tile(scene.state.expression, (FRAMES, 1))
    expression[:, 0] = np.linspace(0.2, 0.5, FRAMES)
    rotation = np.array([turn.as_matrix() @ scene.state.rotation for turn in turns])
    return Course(rotation, np.tile(scene.state.translation, (FRAMES, 1)), expression)


Film = tuple[Tracker, Tracked, list[Frame]]


@pytest.fixture
def film(scene: Scene, course: Course) -> Callable[..., Film]:
    """Makes pictures under given lights, and who follows them."""

    def make(lights: np.ndarray, freeze: tuple[str, ...] = ()) -> Film:
        actor = Actor(scene.geometry, scene.forward, scene.stage, np.eye(4), scene.state)
        frames, landmarks = [], list[Landmarks | None]()
        for index in range(FRAMES):
            pose = course.rotation[index], course.translation[index], course.expression[index]
            state = replace(actor.at(*pose), lights=lights[index])
            color = scene.render(state, samples=4)[0].astype(np.float32)
            shown = Photograph(color, np.ones(color.shape[:2], bool), np.zeros(color.shape, bool))
            frames.append(Frame(index, index + 1, index / 24, str(index), shown))
            landmarks.append(scene.landmarks(state, 0.2, index))
        times, shots = np.arange(FRAMES) / 24, np.zeros(FRAMES, int)
        motion = Motion.start(Triples.of(times, shots), groups_of(scene.model.expression_names))
        empty = np.full(FRAMES, np.nan)
        size = np.zeros((FRAMES, POSE + course.expression.shape[1]))
        tracked = Tracked(course, motion, LandmarkBias.none(68), size, empty, empty)
        return Tracker(actor, landmarks, times, shots, freeze), tracked, frames

    return make


def after_a_look(tracker: Tracker, tracked: Tracked, frames: list[Frame]) -> Tracked:
    pictures = tracker.no_pictures()
    for answer in tracker.looker.answers(tracker.questions(tracked, frames)):
        tracker.heard(pictures, answer)
    return tracker.smoothed(tracked, pictures)


def test_light_that_moves_is_followed(film: Callable[..., Film], scene: Scene):
    away = np.linspace(0.6, 1.4, FRAMES)[:, None]
    near = np.arange(len(scene.state.lights)) < len(scene.state.lights) // 2
    lights = scene.state.lights * np.where(near, away, 2.0 - away)
    tracker, tracked, frames = film(lights)
    course = tracked.course
    first = after_a_look(tracker, tracked, frames)
    assert first.lights is not None
    tracked = after_a_look(tracker, first, frames)
    assert tracked.lights is not None
    ends = [0, -1]
    assert (tracked.photo_rms[ends] < 0.5 * first.photo_rms[ends]).all()
    before, after = (np.abs(one - lights).mean() for one in (scene.state.lights, tracked.lights))
    assert after < 0.9 * before
    # It takes no head along.
    assert np.abs(tracked.course.translation - course.translation)[:, :2].max() < 1e-3
    np.testing.assert_array_equal(tracked.state(tracker.actor, 1).lights, tracked.lights[1])


def test_one_light_stays_one(film: Callable[..., Film], scene: Scene):
    lights = np.tile(scene.state.lights, (FRAMES, 1))
    assert after_a_look(*film(lights)).lights is None


def test_held_light_is_no_unknown(film: Callable[..., Film], scene: Scene):
    lights = scene.state.lights * np.linspace(0.5, 1.5, FRAMES)[:, None]
    tracker, tracked, frames = film(lights, freeze=("lights",))
    assert after_a_look(tracker, tracked, frames).lights is None
    (answer,) = tracker.looker.answers(tracker.questions(tracked, frames[:1]))
    seen = answer.seen
    assert seen is not None and seen.light.hessian.shape == (1, 0, 0)


def test_a_quarter_of_the_pixels_says_as_much_as_all(film: Callable[..., Film], scene: Scene):
    tracker, tracked, frames = film(np.tile(scene.state.lights, (FRAMES, 1)))
    pixels, said = [], []
    for look in (None, 0, 1, 2, 3):
        (question,) = tracker.questions(tracked, frames[2:3], look)
        assert question.cut is not None and question.state is not None
        view = FrameView.of(tracker.actor, question.cut, quarter=question.quarter)
        counted = view.evaluated(question.state).base_weight > 0
        pixels.append(set(map(tuple, np.argwhere(counted).tolist())))
        seen = tracker.looker.answer(question).seen
        assert seen is not None
        said.append(np.diag(seen.said.hessian))
    whole, *parts = pixels
    together = set().union(*parts)
    assert sum(map(len, parts)) == len(together)
    assert len(whole & together) > 0.8 * len(whole)
    for quarter in said[1:]:
        np.testing.assert_allclose(quarter[said[0] > 0] / said[0][said[0] > 0], 1.0, atol=0.6)
        assert abs(np.log(quarter / said[0]).mean()) < 0.5


def test_the_last_look_and_light_that_moves_want_all_pixels(
    film: Callable[..., Film], scene: Scene
):
    lights = np.tile(scene.state.lights, (FRAMES, 1))
    tracked = film(lights)[1]
    assert [tracked.wants_all_pixels(number, 3) for number in range(3)] == [False, False, True]
    assert replace(tracked, lights=lights).wants_all_pixels(0, 3)


def test_beside_a_picture_landmarks_of_lids_count_in_full(
    film: Callable[..., Film], scene: Scene, monkeypatch: pytest.MonkeyPatch
):
    trusts: list[Any] = []

    def evidence(*given: object) -> object:
        trusts.append(given[-1])
        return landmark_evidence(*given)  # type: ignore[arg-type]

    monkeypatch.setattr("facestage.fit.sequence.tracking.landmark_evidence", evidence)
    tracker, tracked, frames = film(np.tile(scene.state.lights, (FRAMES, 1)))
    after_a_look(tracker, tracked, frames[1:])
    assert trusts[0] is None
    # Of its three expressions none is a lid's.
    np.testing.assert_array_equal(trusts[1], BESIDE_PICTURE)
    tracker._groups = tracker._groups.copy()
    tracker._groups[POSE + 2] = LIDS  # let its brows be lids
    tracker._trusts.clear()
    full = tracker._beside_picture("ibug68") == 1.0
    assert full[17:27].any() and not full.all()


def test_deviations_are_twice_the_smoothed_and_no_more_than_of_the_frame_alone():
    smoothed = np.full((2, POSE + 2), 0.1)
    hessian = np.tile(np.eye(POSE + 2), (2, 1, 1)) * [[[1.0 / 0.15**2]], [[1.0]]]
    found = honest(smoothed, hessian)
    np.testing.assert_array_equal(found[:, :POSE], 0.1)
    np.testing.assert_allclose(found[:, POSE:], [[0.15, 0.15], [ALIKE * 0.1, ALIKE * 0.1]])
    hessian[0, 0, 0] = 0.0  # no face: nothing but the neighbours
    np.testing.assert_allclose(honest(smoothed, hessian)[0, POSE:], ALIKE * 0.1)


def test_a_checkpoint_comes_back_with_its_light_and_an_older_one_begins_the_looks_anew(
    film: Callable[..., Film], scene: Scene, tmp_path: Path
):
    lights = np.tile(scene.state.lights, (FRAMES, 1))
    tracker, tracked, frames = film(lights)
    pictures = tracker.no_pictures()
    (answer,) = tracker.looker.answers(tracker.questions(tracked, frames[:1]))
    tracker.heard(pictures, answer)
    PassCheckpoint(1, 1, replace(tracked, lights=lights), pictures).save(tmp_path)
    found = PassCheckpoint.load(tmp_path)
    assert found is not None and found.tracked.lights is not None
    np.testing.assert_array_equal(found.tracked.lights, lights)
    for name in ("hessian", "gradient", "cross", "cost"):
        one, other = getattr(found.pictures.light, name), getattr(pictures.light, name)
        np.testing.assert_array_equal(one, other)

    arrays = read_arrays(tmp_path / SEQUENCE_CHECKPOINT, "checkpoint")
    older = {name: value for name, value in arrays.items() if not name.startswith("light")}
    write_arrays(tmp_path / SEQUENCE_CHECKPOINT, older)
    assert PassCheckpoint.load(tmp_path) is None


def test_frames_without_a_face_rest(scene: Scene, course: Course):
    """As where a hand covers it in all frames that are fitted again."""
    actor = Actor(scene.geometry, scene.forward, scene.stage, np.eye(4), scene.state)
    shots = np.ones(FRAMES, int)
    tracker = Tracker(actor, [None] * FRAMES, np.arange(FRAMES) / 24.0, shots)
    groups = groups_of(scene.model.expression_names)
    motion = Motion.start(Triples.of(np.arange(FRAMES) / 24.0, shots), groups)
    empty, size = np.full(FRAMES, np.nan), np.zeros((FRAMES, POSE + course.expression.shape[1]))
    tracked = Tracked(course, motion, LandmarkBias.none(0), size, empty, empty)
    found = tracker.with_bias(tracker.smoothed(tracker.with_bias(tracked), None))
    assert np.isfinite(found.course.translation).all()
    np.testing.assert_allclose(found.course.translation, course.translation, atol=1e-3)
