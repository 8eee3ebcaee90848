"""Pieces put together: what each has found of its own frames, and one last smoothing of all.

What frames say is known at the course that a piece last looked at them from. That of all pieces in
one system is what one process would have before its last smoothing, but for what the pieces'
earlier smoothings did not know of each other.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields, replace

import numpy as np

from facestage.contract.arrays import Float
from facestage.fit.pieces.cutting import Piece
from facestage.fit.sequence.course import Course
from facestage.fit.sequence.motion import Motion, Triples
from facestage.fit.sequence.tracking import Pictures, Tracked


def together(
    pieces: Sequence[Piece],
    found: Sequence[Tracked | None],
    triples: Triples,
    common: Float[np.ndarray, " lights"],
) -> Tracked:
    """All frames from what was ``found`` of each piece, of which one at least shows the face; in
    those without (None) it rests where it was seen last, or next. ``triples`` are the whole film's,
    ``common`` the light of frames whose light did not move.
    """
    shown = [(piece, one) for piece, one in zip(pieces, found, strict=True) if one is not None]
    count, usual = pieces[-1].end, shown[0][1]
    known = np.concatenate([np.arange(piece.first, piece.end) for piece, _ in shown])
    nearest = np.abs(np.arange(count)[:, None] - known).argmin(axis=1)

    def of(get: Callable[[Tracked], np.ndarray], missing: float | None = None) -> np.ndarray:
        values = np.concatenate([get(one)[piece.inside] for piece, one in shown])[nearest]
        if missing is not None:
            values[known[nearest] != np.arange(count)] = missing
        return values

    lights = None
    if any(one.lights is not None for _, one in shown):
        lights = of(
            lambda one: np.tile(common, (len(one.course), 1)) if one.lights is None else one.lights
        )
    course = Course(
        of(lambda one: one.course.rotation),
        of(lambda one: one.course.translation),
        of(lambda one: one.course.expression, 0.0),
    )
    weights = of(lambda one: _by_middle(one.motion, len(one.course)), 1.0)
    sizes = [piece.end - piece.first for piece, _ in shown]
    scales = np.exp(np.average([np.log(one.motion.scales) for _, one in shown], 0, sizes))
    motion = Motion(triples, usual.motion.groups, scales, weights[triples.frames[:, 1]])
    return Tracked(
        course,
        motion,
        usual.bias,
        of(lambda one: one.deviation),
        of(lambda one: one.landmark_rms, np.nan),
        of(lambda one: one.photo_rms, np.nan),
        lights,
    )


def part_of(tracked: Tracked, frames: slice, triples: Triples) -> Tracked:
    """Some of the frames, whose own ``triples`` they are."""
    course, motion = tracked.course, tracked.motion
    weights = _by_middle(motion, len(course))[frames][triples.frames[:, 1]]
    return Tracked(
        Course(course.rotation[frames], course.translation[frames], course.expression[frames]),
        replace(motion, triples=triples, weights=weights),
        tracked.bias,
        tracked.deviation[frames],
        tracked.landmark_rms[frames],
        tracked.photo_rms[frames],
        None if tracked.lights is None else tracked.lights[frames],
    )


def said_together(
    window: Piece,
    pieces: Sequence[Piece],
    said: Callable[[Piece], Pictures | None],
    empty: Pictures,
) -> Pictures:
    """What the pictures of a ``window`` of the film ``said``, each by the piece that answers for
    it, written into what is ``empty``.
    """
    for piece in pieces:
        first, end = max(piece.first, window.start), min(piece.end, window.stop)
        pictures = said(piece) if first < end else None
        if pictures is None:
            continue
        into = slice(first - window.start, end - window.start)
        own = slice(first - piece.start, end - piece.start)
        for to, source in ((empty, pictures), (empty.light, pictures.light)):
            for each in fields(to):
                values = getattr(to, each.name)
                if isinstance(values, np.ndarray):
                    values[into] = getattr(source, each.name)[own]
    return empty


def _by_middle(motion: Motion, frames: int) -> Float[np.ndarray, "frames unknowns"]:
    """The weights of second differences by the frame in their middle; 1 where there is none."""
    result = np.ones((frames, motion.weights.shape[1]))
    result[motion.triples.frames[:, 1]] = motion.weights
    return result
