"""The steps of a film that is followed in pieces: it is begun, its pieces are followed apart, in
any order and by any processes that see its files, and joined.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from facestage.contract import sequence as contract
from facestage.contract.files.partial import PIECES, partial_folder
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.pieces.cutting import Piece, cut
from facestage.fit.pieces.joining import part_of, said_together, together
from facestage.fit.pieces.shared import Shared, save_shared
from facestage.fit.result.run import kept_unless_refused
from facestage.fit.runs.place import claimed
from facestage.fit.sequence.checkpoint import PassCheckpoint
from facestage.fit.sequence.motion import Triples
from facestage.fit.sequence.output import Found
from facestage.fit.sequence.request import Request
from facestage.fit.sequence.run import SequenceRun, put_in_place
from facestage.fit.sequence.sequence_truth import SequenceTruth
from facestage.fit.sequence.tracking import Pictures, Tracked, Tracker
from facestage.images.film import Film
from facestage.render.variant import start_renderer

# Frames that are smoothed at once when pieces are joined: 450 MB for each 1,000. Of a longer film,
# windows of so many overlap by so much on each side.
WINDOW, WINDOW_OVERLAP = 2000, 100


def begin_film(
    request: Request,
    out: Path,
    most: int,
    resume: bool = False,
    landmark_model: Path | None = None,
    fineness: Fineness = USUAL,
) -> contract.Sequence | int:
    """Find the face in all frames and fit the keyframes, and say in how many pieces of ``most``
    frames the film is to be followed; one that needs no second is followed, and written into the
    folder ``out``. Raises InputError.
    """
    film, out = Film(request.film, request.rate), Path(out).resolve()
    with claimed(out, contract.FILE) as partial:
        run = SequenceRun(
            request, film, partial, lambda _: None, landmark_model, fineness, apart=True
        )
        with kept_unless_refused(partial, resume):
            prepared = run.prepare(resume)
            pieces = len(cut(len(prepared.sightings), most))
            # Seconds cannot be dealt out to pieces that nobody has begun.
            if pieces > 1 and request.budget_seconds is None:
                tracker, _ = run.person_in_light(prepared)
                save_shared(partial, prepared, tracker.actor.state.lights)
                return pieces
            found = run.follow(prepared, resume)
        return put_in_place(out, request, found, run.tracker, partial)


def follow_piece(request: Request, out: Path, most: int, number: int) -> None:
    """Follow the piece ``number`` (from 0) of a film that was begun, from where an earlier process
    left it.
    """
    partial = partial_folder(Path(out).resolve())
    start_renderer(request.device)
    shared = Shared.load(request, partial)
    prepared = shared.prepared
    piece = cut(len(prepared.sightings), most)[number]
    tracker = prepared.tracker(shared.actor, request.freeze, piece.looked_at)
    if not any(tracker.landmarks):
        return
    folder = partial / PIECES / piece.name
    folder.mkdir(exist_ok=True)
    film = Film(request.film, request.rate).part(piece.start, piece.stop)
    run = SequenceRun(request, film, folder, lambda _: None, None, USUAL, apart=True)
    run.tracker = tracker
    checkpoint = PassCheckpoint.load(folder)
    if checkpoint is None:
        tracked = run.by_landmarks(prepared.shown, shared.states)
        checkpoint = PassCheckpoint(0, 0, tracked, tracker.no_pictures())
        checkpoint.save(folder)
    run.by_pictures(checkpoint, unsmoothed=True)


def join_film(
    request: Request, out: Path, most: int, timings: Mapping[str, float]
) -> contract.Sequence:
    """Put the pieces of a film together, smooth them, and write the folder ``out``. ``timings``:
    what the steps before have taken, in seconds.
    """
    began, out = time.monotonic(), Path(out).resolve()
    film = Film(request.film, request.rate)
    with claimed(out, contract.FILE) as partial:
        start_renderer(request.device)
        shared = Shared.load(request, partial)
        prepared, actor = shared.prepared, shared.actor
        run = SequenceRun(request, film, partial, lambda _: None, None, USUAL, apart=True)
        run.tracker = prepared.tracker(actor, request.freeze)
        tracked = smoothed_together(shared, request, partial / PIECES, most)
        skin = run.skin(tracked, prepared) if request.dynamic_skin else None
        wrinkles = run.wrinkles(tracked, prepared) if request.dynamic_skin else None
        truth, errors = request.truth, dict[str, float]()
        if truth is not None:
            known = SequenceTruth(truth, prepared.model, len(prepared.sightings))
            errors = known.errors(actor.geometry.model, tracked.course)
        found = Found(
            film,
            prepared.sightings,
            prepared.keyframes,
            prepared.person,
            prepared.results[0],
            prepared.model,
            tracked,
            errors,
            {},
            {**timings, **run.timings, "joining": time.monotonic() - began},
            True,
            skin,
            wrinkles,
        )
        return put_in_place(out, request, found, run.tracker, partial)


def smoothed_together(shared: Shared, request: Request, folder: Path, most: int) -> Tracked:
    """All frames after one last smoothing, of as many at once as memory is meant for."""
    prepared, actor = shared.prepared, shared.actor
    count, common = len(prepared.sightings), actor.state.lights
    pieces, windows = cut(count, most), cut(count, WINDOW, WINDOW_OVERLAP)

    def found(piece: Piece) -> PassCheckpoint | None:
        return PassCheckpoint.load(folder / piece.name)

    def tracked_of(piece: Piece) -> Tracked | None:
        checkpoint = found(piece)  # what its pictures said is let go again at once
        return None if checkpoint is None else checkpoint.tracked

    def said(piece: Piece) -> Pictures | None:
        checkpoint = found(piece)
        return None if checkpoint is None else checkpoint.pictures

    triples = Triples.of(np.array(prepared.sightings.times), prepared.sightings.shots)
    whole = together(pieces, [tracked_of(piece) for piece in pieces], triples, common)

    def smoothed(window: Piece) -> Tracked:
        tracker: Tracker = prepared.tracker(actor, request.freeze, window.looked_at)
        pictures = None
        if request.passes:
            pictures = said_together(window, pieces, said, tracker.no_pictures())
        own = Triples.of(
            np.array(prepared.sightings.times)[window.looked_at],
            prepared.sightings.shots[window.looked_at],
        )
        tracked = tracker.with_bias(part_of(whole, window.looked_at, own))
        return tracker.smoothed(tracked, pictures)

    return together(windows, [smoothed(window) for window in windows], triples, common)
