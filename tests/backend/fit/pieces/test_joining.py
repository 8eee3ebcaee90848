"""What pieces have found is put where it belongs."""

from __future__ import annotations

import numpy as np

from facestage.fit.pieces.cutting import Piece, cut
from facestage.fit.pieces.joining import part_of, said_together, together
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.landmark_bias import LandmarkBias
from facestage.fit.sequence.motion import Motion, Triples
from facestage.fit.sequence.tracking import Pictures, Tracked

FRAMES, WEIGHTS, LIGHTS = 11, 2, 4
SIZE = POSE + WEIGHTS
TRIPLES = Triples.of(np.arange(FRAMES) / 24.0, np.ones(FRAMES, int))
PIECES = cut(FRAMES, 4, overlap=2)
COMMON = np.full(LIGHTS, 7.0)


def tracked(frames: int, triples: Triples, first: int = 0, **changes: object) -> Tracked:
    """All numbers of a frame are its index in the film."""
    index = np.arange(first, first + frames, dtype=float)
    course = Course(
        index[:, None, None] * np.ones((3, 3)),
        index[:, None] * np.ones(3),
        index[:, None] * np.ones(WEIGHTS),
    )
    weights = (first + triples.frames[:, 1])[:, None] * np.ones(SIZE)
    groups = np.zeros(SIZE, int)
    known = {
        "course": course,
        "motion": Motion(triples, groups, np.full(SIZE, 2.0), weights),
        "bias": LandmarkBias.none(3),
        "deviation": index[:, None] * np.ones(SIZE),
        "landmark_rms": index,
        "photo_rms": index,
    }
    return Tracked(**{**known, **changes})  # type: ignore[arg-type]


def piece_of(piece: Piece, **changes: object) -> Tracked:
    count = piece.stop - piece.start
    triples = Triples.of(np.arange(count) / 24.0, np.ones(count, int))
    return tracked(count, triples, piece.start, **changes)


def assert_same(found: Tracked, wanted: Tracked) -> None:
    for name in ("deviation", "landmark_rms", "photo_rms"):
        np.testing.assert_array_equal(getattr(found, name), getattr(wanted, name))
    for name in ("rotation", "translation", "expression"):
        np.testing.assert_array_equal(getattr(found.course, name), getattr(wanted.course, name))
    np.testing.assert_array_equal(found.motion.triples.frames, wanted.motion.triples.frames)
    np.testing.assert_array_equal(found.motion.weights, wanted.motion.weights)


def test_each_frame_comes_from_the_piece_that_answers_for_it():
    whole = tracked(FRAMES, TRIPLES)
    found = together(PIECES, [piece_of(piece) for piece in PIECES], TRIPLES, COMMON)
    assert_same(found, whole)
    assert found.lights is None
    np.testing.assert_allclose(found.motion.scales, 2.0)
    for piece in PIECES:
        own = piece_of(piece)
        assert_same(part_of(whole, piece.looked_at, own.motion.triples), own)


def test_frames_without_a_face_rest_where_it_was_nearest():
    first, middle, last = PIECES
    found = together(PIECES, [piece_of(first), None, piece_of(last)], TRIPLES, COMMON)
    place = found.course.translation[:, 0]
    assert set(place[middle.own]) == {first.end - 1, last.first}
    assert (np.diff(place) >= 0).all() and (found.course.expression[middle.own] == 0).all()
    assert np.isnan(found.photo_rms[middle.own]).all()
    assert not np.isnan(found.photo_rms[first.own]).any()
    np.testing.assert_array_equal(found.motion.weights[middle.first], 1.0)


def test_light_that_moves_in_one_piece_is_the_common_one_in_others():
    first, middle, last = PIECES
    moved = np.ones((last.stop - last.start, LIGHTS))
    pieces = [piece_of(first), piece_of(middle), piece_of(last, lights=moved)]
    found = together(PIECES, pieces, TRIPLES, COMMON)
    assert found.lights is not None
    np.testing.assert_array_equal(found.lights[middle.own], 7.0)
    np.testing.assert_array_equal(found.lights[last.own], 1.0)


def test_what_pictures_say_is_put_together_for_any_window():
    def said(piece: Piece) -> Pictures | None:
        if piece == PIECES[1]:
            return None
        pictures = Pictures.none(piece.stop - piece.start, SIZE, LIGHTS)
        index = np.arange(piece.start, piece.stop, dtype=float)
        pictures.gradient[:], pictures.rms[:] = index[:, None], index
        pictures.light.cost[:] = index
        return pictures

    window = Piece(3, 9, 1, 10)
    found = said_together(window, PIECES, said, Pictures.none(9, SIZE, LIGHTS))
    wanted = np.arange(1.0, 10.0)
    gone = (wanted >= PIECES[1].first) & (wanted < PIECES[1].end)
    np.testing.assert_array_equal(found.rms, np.where(gone, np.nan, wanted))
    np.testing.assert_array_equal(found.light.cost, np.where(gone, 0.0, wanted))
    np.testing.assert_array_equal(found.gradient[:, 3], np.where(gone, 0.0, wanted))
