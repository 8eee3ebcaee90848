"""One whole sequence: film in, folder out, events on the way."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from facestage.contract import sequence as contract
from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.files.color import linear_to_srgb
from facestage.contract.files.partial import (
    KEYFRAME_PICTURES,
    KEYFRAMES,
    PREVIEW,
    forget_checkpoint,
)
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from facestage.contract.person import FILE as PERSON
from facestage.contract.person import Person
from facestage.contract.result import Result
from facestage.contract.result_files import is_result_file
from facestage.fit.face.state import State
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.fit.result.person import fit_person
from facestage.fit.result.run import kept_unless_refused
from facestage.fit.runs.place import claimed
from facestage.fit.sequence.checkpoint import PassCheckpoint
from facestage.fit.sequence.common_light import with_common_light
from facestage.fit.sequence.crew import Crew
from facestage.fit.sequence.frames import Cut
from facestage.fit.sequence.keyframes import Prepared, choose_keyframes
from facestage.fit.sequence.looking import Looker
from facestage.fit.sequence.output import Found, write_sequence
from facestage.fit.sequence.request import Request
from facestage.fit.sequence.sequence_truth import SequenceTruth
from facestage.fit.sequence.sightings import Sightings, look_through
from facestage.fit.sequence.skin.changes import Look, SkinChanges, skin_changes
from facestage.fit.sequence.skin.leftover import SKIN_PX
from facestage.fit.sequence.tracking import LANDMARK_PASSES, Tracked, Tracker
from facestage.fit.sequence.wrinkles.sheets import FACE_PX
from facestage.fit.sequence.wrinkles.wrinkles import Asked, FilmWrinkles, film_wrinkles
from facestage.images.film import Film, Frame
from facestage.images.image_io import write_png
from facestage.models.registry import load_model
from facestage.render.variant import start_renderer, traces_here
from facestage.report import write_preview

T = TypeVar("T")
# Where on the scale from 0 to 1 each part of the work ends.
LOOKED_THROUGH, FITTED, FOLLOWED, SEEN = 0.1, 0.55, 0.6, 0.9
LOOKED_AT_SKIN, LOOKED_AT_WRINKLES = 0.94, 0.97
# Of a budget in seconds, what the keyframes may take.
KEYFRAME_SHARE = 0.6
SAVED_EVERY = 10.0  # seconds
PREVIEW_EVERY = 10.0  # seconds; drawing one takes as long as a look at a frame


def track_film(
    request: Request,
    out: Path,
    resume: bool = False,
    emit: Callable[[Event], None] = lambda event: None,
    landmark_model: Path | None = None,
    fineness: Fineness = USUAL,
) -> contract.Sequence:
    """Follow the face of a film and write the folder ``out``. Raises InputError before anything is
    written.
    """
    out = Path(out).resolve()
    film = Film(request.film, request.rate)
    with claimed(out, contract.FILE) as partial:
        run = SequenceRun(request, film, partial, emit, landmark_model, fineness)
        with kept_unless_refused(partial, resume):
            found = run.run(resume)
        track = put_in_place(out, request, found, run.tracker, partial)
    run.tell(DONE, "done", 1.0, track.advice)
    return track


def put_in_place(
    out: Path, request: Request, found: Found, tracker: Tracker, partial: Path
) -> contract.Sequence:
    """Write the folder ``out`` of a sequence, whole; its ``partial`` folder has done its part."""
    with atomic_folder(out, is_result_file) as folder:
        track = write_sequence(folder, request, found, tracker, partial)
    if found.in_time:
        forget_checkpoint(partial)
    return replace(track, folder=out)


class SequenceRun:
    """The steps from a film to its course; ``partial`` keeps what a run needs to go on.
    ``apart``: in one process, and nobody sees previews.
    """

    tracker: Tracker

    def __init__(
        self,
        request: Request,
        film: Film,
        partial: Path,
        emit: Callable[[Event], None],
        landmark_model: Path | None,
        fineness: Fineness,
        *,
        apart: bool = False,
    ) -> None:
        self.request, self.film, self.partial, self._apart = request, film, partial, apart
        self._emit, self._landmark_model, self._fineness = emit, landmark_model, fineness
        self._began = time.monotonic()
        self._drawn = -np.inf  # when the last preview was, by the clock
        self._preview: str | None = None  # its file
        self._elsewhere = 0.0  # seconds of processor time of other processes
        self.timings: dict[str, float] = {}

    def tell(
        self, kind: str, stage: str, fraction: float, words: str, error: float | None = None
    ) -> None:
        """One event."""
        seconds = time.monotonic() - self._began
        left = seconds * (1 - fraction) / fraction if fraction > 0.02 else None
        self._emit(
            Event(
                kind,
                stage,
                error=error,
                seconds=seconds,
                seconds_left=left,
                fraction=fraction,
                preview=self._preview,
                message=words,
            )
        )

    def _previewed(self, frames: Iterable[Frame], tracked: Tracked) -> Iterator[Frame]:
        """``frames``, of which one is drawn beside its fit now and then."""
        # By a scene of its own: what was traced before shows in the last digits of what follows.
        actor = copy(self.tracker.actor)
        for frame in frames:
            due = not self._apart and time.monotonic() - self._drawn > PREVIEW_EVERY
            view = self.tracker.view(frame, actor) if due else None
            if view is not None:
                photo = view.term.photo.color
                evaluation = view.evaluated(tracked.state(actor, frame.index))
                path = self.partial / PREVIEW
                write_preview(path, photo, photo + evaluation.residual)
                self._drawn, self._preview = time.monotonic(), str(path)
            yield frame

    def run(self, resume: bool) -> Found:
        """All of it, or what an earlier run left to be done."""
        return self.follow(self.prepare(resume), resume)

    def prepare(self, resume: bool) -> Prepared:
        """The face in all frames, and the person of the keyframes."""
        request = self.request
        self.tell(STARTED, "", 0.0, f"Reading {self.film.path.name}")
        model = load_model(request.model)
        origin = f"Face model: {model.name}; licence: {model.license}; {model.source}"
        self.tell(PROGRESS, "model", 0.0, origin)
        sightings = self._timed("landmarks", lambda: self._sightings(resume))
        truth = None
        if request.truth is not None:
            truth = SequenceTruth(request.truth, model, len(sightings))
        landmarks = sightings.landmarks(model)
        chosen = choose_keyframes(landmarks, sightings.confidence, self._fineness.keyframes)
        if len(chosen) < 2:
            raise InputError(
                f"The frames of '{self.film.path}' all show the same; fit one of them as a photo: "
                "facestage fit."
            )
        camera = self._camera(sightings)
        start_renderer(request.device)
        shown = [one for one in (landmarks[index] for index in chosen) if one is not None]
        frames = list(self._frames(chosen))
        person = self._timed("keyframes", lambda: self._person(frames, shown, camera, resume))
        results = [Result.load(self.partial / KEYFRAMES / photo.folder) for photo in person.photos]
        return Prepared(model, sightings, landmarks, chosen, frames, person, results, truth)

    def follow(self, prepared: Prepared, resume: bool) -> Found:
        """All frames of a film that is ``prepared``."""
        deadline = np.inf
        if self.request.budget_seconds is not None:
            deadline = self._began + self.request.budget_seconds
        self.tracker, states = self.person_in_light(prepared)
        own, by_landmarks = self.tracker.actor.geometry.model, dict[str, float]()
        truth = prepared.truth
        checkpoint = PassCheckpoint.load(self.partial) if resume else None
        # Processes begin while this one is at the landmarks.
        with self._crew(checkpoint, len(prepared.sightings)) as crew:
            if checkpoint is None:
                tracked = self.by_landmarks(prepared.shown, states)
                by_landmarks = {} if truth is None else truth.errors(own, tracked.course)
                checkpoint = PassCheckpoint(0, 0, tracked, self.tracker.no_pictures())
            tracked = self.by_pictures(checkpoint, deadline, crew)
        skin, wrinkles = None, None
        if self.request.dynamic_skin and time.monotonic() <= deadline:
            skin = self.skin(tracked, prepared)
            wrinkles = self.wrinkles(tracked, prepared)
        in_time = time.monotonic() <= deadline
        errors = {} if truth is None else truth.errors(own, tracked.course)
        self.tell(PROGRESS, "pictures", LOOKED_AT_WRINKLES, "Writing the sequence")
        return Found(
            self.film,
            prepared.sightings,
            prepared.keyframes,
            prepared.person,
            prepared.results[0],
            prepared.model,
            tracked,
            errors,
            by_landmarks,
            self.timings | {"total": time.monotonic() - self._began},
            in_time,
            skin,
            wrinkles,
        )

    def _timed(self, name: str, work: Callable[[], T]) -> T:
        began, cpu = time.monotonic(), time.process_time() + self._elsewhere
        result = work()
        self.timings[name] = time.monotonic() - began
        self.timings[f"{name}_cpu"] = time.process_time() + self._elsewhere - cpu
        return result

    def _sightings(self, resume: bool) -> Sightings:
        """The landmarks of all frames."""
        fingerprint = self.request.fingerprint
        found = Sightings.load(self.partial, fingerprint) if resume else Sightings()

        def tell(sightings: Sightings) -> None:
            count = self.film.count
            words = f"Finding the face: frame {len(sightings)}" + (f" of {count}" if count else "")
            share = len(sightings) / count if count else 0.0
            self.tell(PROGRESS, "landmarks", LOOKED_THROUGH * min(share, 1.0), words)

        def keep(sightings: Sightings) -> None:
            sightings.save(self.partial, fingerprint)

        if resume and len(found) == self.film.count:
            return found
        return look_through(self.film, found, self._landmark_model, self.request.face, keep, tell)

    def _camera(self, sightings: Sightings) -> Camera | None:
        """The given one; None: the keyframes find the lens."""
        width, height = sightings.size
        if self.request.focal_px is not None:
            return Camera.default(width, height, self.request.focal_px)
        camera = self.request.camera
        if camera is not None and (camera.width, camera.height) != (width, height):
            raise InputError(
                f"The camera is for {camera.width} x {camera.height} pixels but the frames of "
                f"'{self.film.path}' have {width} x {height}; give the camera of this film."
            )
        return camera

    def _frames(self, chosen: Sequence[int]) -> Iterator[Frame]:
        """The frames with these indices, one by one."""
        wanted = set(chosen)
        for frame in self.film.frames(min(chosen)):
            if frame.index in wanted:
                yield frame
            if frame.index >= max(chosen):
                return

    def _person(
        self,
        frames: Sequence[Frame],
        landmarks: Sequence[Landmarks],
        camera: Camera | None,
        resume: bool,
    ) -> Person:
        """The keyframes as photos of one person."""
        folder = self.partial / KEYFRAMES
        pictures = [self._picture(frame) for frame in frames]
        if resume and (folder / PERSON).is_file():
            person = Person.load(folder)
            if [Path(photo.image) for photo in person.photos] == pictures:
                return person
        budget = self.request.budget_seconds
        request = self.request
        jobs = [
            Job(
                image=picture,
                model=request.model,
                landmarks=own,
                camera=camera,
                stage=fibonacci_stage(),
                freeze=request.freeze,
                seed=request.seed,
                device=request.device,
                budget_seconds=None if budget is None else KEYFRAME_SHARE * budget,
            )
            for picture, own in zip(pictures, landmarks, strict=True)
        ]

        def tell(event: Event) -> None:
            if event.kind == PROGRESS:
                fraction = LOOKED_THROUGH + (FITTED - LOOKED_THROUGH) * event.fraction
                self._emit(
                    replace(
                        event,
                        fraction=fraction,
                        seconds=time.monotonic() - self._began,
                        seconds_left=None,
                        message=f"Keyframes: {event.message}",
                    )
                )

        return fit_person(jobs, folder, resume, tell, self._landmark_model, self._fineness)

    def _picture(self, frame: Frame) -> Path:
        """A file that shows ``frame``: the folder's, or one that is kept beside the checkpoint."""
        path = self.film.picture(frame.index)
        if path is not None:
            return path.absolute()
        path = self.partial / KEYFRAME_PICTURES / f"frame-{frame.number}.png"
        path.parent.mkdir(exist_ok=True)
        pixels = np.round(255 * linear_to_srgb(np.clip(frame.photograph.color, 0, 1)))
        write_png(path, pixels.astype(np.uint8))
        return path

    def person_in_light(self, prepared: Prepared) -> tuple[Tracker, list[State]]:
        """The person under one light, and where the keyframes have the face."""
        actor, states = prepared.person_found()
        if self.request.passes and "lights" not in self.request.freeze:
            self.tell(PROGRESS, "light", FITTED, "One light for all frames")
            pictures = [frame.photograph for frame in prepared.frames]
            actor = with_common_light(actor, pictures, prepared.shown, states)
        return prepared.tracker(actor, self.request.freeze), states

    def by_landmarks(self, shown: Sequence[Landmarks], states: Sequence[State]) -> Tracked:
        """All frames by their landmarks, after keyframes that have ``shown`` theirs where their
        ``states`` are.
        """

        def tell(number: int) -> None:
            fraction = FITTED + (FOLLOWED - FITTED) * number / LANDMARK_PASSES
            self.tell(PROGRESS, "smoothing", fraction, f"Smoothing the landmarks: round {number}")

        return self._timed("smoothing", lambda: self.tracker.by_landmarks(shown, states, tell))

    def _crew(
        self, checkpoint: PassCheckpoint | None, frames: int
    ) -> AbstractContextManager[Crew | None]:
        """Who looks at what is left of the pictures; None: this process alone."""
        looks = self.request.passes * frames
        if checkpoint is not None:
            looks -= checkpoint.number * frames + checkpoint.done
        alone = self._apart or not traces_here()
        crew = None if alone else Crew.of(self.tracker.looker, looks)
        return crew or nullcontext()

    def by_pictures(
        self,
        checkpoint: PassCheckpoint,
        deadline: float = np.inf,
        crew: Crew | None = None,
        *,
        unsmoothed: bool = False,
    ) -> Tracked:
        """Look at the pictures of all frames, and smooth; again and again. ``unsmoothed``: what the
        last look has found stays in the checkpoint for who smooths it with more.
        """

        def work() -> Tracked:
            looker = crew or self.tracker.looker
            tracked = self._looked(checkpoint, deadline, looker, unsmoothed)
            if crew is not None:
                self._elsewhere += crew.seconds
            return tracked

        return self._timed("pictures", work)

    def _looked(
        self, checkpoint: PassCheckpoint, deadline: float, looker: Looker | Crew, unsmoothed: bool
    ) -> Tracked:
        tracked, tracker = checkpoint.tracked, self.tracker
        frames, passes = len(tracked.course), self.request.passes
        saved = time.monotonic()
        for number in range(checkpoint.number, passes):
            before = checkpoint if number == checkpoint.number else None
            pictures = tracker.no_pictures() if before is None else before.pictures
            left = self.film.frames(0 if before is None else before.done)
            shown = self._previewed(left, tracked)
            look = None if tracked.wants_all_pixels(number, passes) else number
            for answer in looker.answers(tracker.questions(tracked, shown, look)):
                tracker.heard(pictures, answer)
                done = answer.index + 1
                share = (number + done / frames) / passes
                words = f"Pictures, pass {number + 1} of {passes}: frame {done} of {frames}"
                rms = float(pictures.rms[answer.index])
                self.tell(
                    PROGRESS,
                    "pictures",
                    FOLLOWED + (SEEN - FOLLOWED) * share,
                    words,
                    rms if np.isfinite(rms) else None,
                )
                if time.monotonic() - saved > SAVED_EVERY:
                    saved = time.monotonic()
                    PassCheckpoint(number, done, tracked, pictures).save(self.partial)
            if unsmoothed and number == passes - 1:
                PassCheckpoint(number, frames, tracked, pictures).save(self.partial)
                break
            tracked = tracker.with_bias(tracker.smoothed(tracked, pictures))
            PassCheckpoint(number + 1, 0, tracked, tracker.no_pictures()).save(self.partial)
            if time.monotonic() > deadline:
                break
        return tracked

    def skin(self, tracked: Tracked, prepared: Prepared) -> SkinChanges:
        """What all frames have left over on the skin."""
        actor, landmarks = self.tracker.actor, prepared.landmarks

        def looks() -> Iterator[Look]:
            for frame in self.film.frames():
                if frame.index >= len(landmarks):
                    return
                share = (frame.index + 1) / len(landmarks)
                words = f"Skin: frame {frame.index + 1} of {len(landmarks)}"
                self.tell(PROGRESS, "skin", SEEN + (LOOKED_AT_SKIN - SEEN) * share, words)
                own = landmarks[frame.index]
                if own is not None:
                    cut = Cut.of(frame.photograph, own, SKIN_PX)
                    yield Look(frame.index, cut, tracked.state(actor, frame.index))

        times, shots = np.array(prepared.sightings.times), prepared.sightings.shots
        return self._timed(
            "skin", lambda: skin_changes(actor, looks(), times, shots, prepared.keyframes)
        )

    def wrinkles(self, tracked: Tracked, prepared: Prepared) -> FilmWrinkles:
        """What comes with expressions, by the frames that tell most of it."""
        actor, landmarks = self.tracker.actor, prepared.landmarks
        asked = Asked.of(actor.geometry, tracked.course.expression, landmarks)

        def looks() -> Iterator[Look]:
            for done, frame in enumerate(self._frames(asked.frames.tolist()), 1):
                share = done / len(asked.frames)
                words = f"Wrinkles: frame {done} of {len(asked.frames)}"
                where = LOOKED_AT_SKIN + (LOOKED_AT_WRINKLES - LOOKED_AT_SKIN) * share
                self.tell(PROGRESS, "skin", where, words)
                own = landmarks[frame.index]
                assert own is not None
                cut = Cut.of(frame.photograph, own, FACE_PX)
                yield Look(frame.index, cut, tracked.state(actor, frame.index))

        return self._timed("wrinkles", lambda: film_wrinkles(actor, asked, looks()))
