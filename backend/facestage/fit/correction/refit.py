"""A sequence fitted again where it was corrected: folder in, the same folder out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from facestage.contract import sequence as contract
from facestage.contract.arrays import Float
from facestage.contract.corrections import Correction
from facestage.contract.errors import InputError
from facestage.contract.events import DONE, PROGRESS, STARTED, Event
from facestage.contract.face_model import FaceModel
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.landmarks import Landmarks
from facestage.contract.person import Person
from facestage.contract.result import Result
from facestage.contract.result_files import LANDMARKS, is_result_file
from facestage.contract.texture_maps import ALBEDO
from facestage.fit.correction.keyed import Keyed, Keys
from facestage.fit.correction.rewriting import course_of, put_together, write_again
from facestage.fit.correction.span import FrameRange, Span, span_of
from facestage.fit.given.detection import known_to
from facestage.fit.runs.place import claimed
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.common_light import with_common_light
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.crew import Crew
from facestage.fit.sequence.landmark_bias import LandmarkBias
from facestage.fit.sequence.motion import Motion, Triples, groups_of
from facestage.fit.sequence.output import shown_frames, some_of
from facestage.fit.sequence.sequence_truth import SequenceTruth
from facestage.fit.sequence.smoother import Evidence
from facestage.fit.sequence.tracking import Tracked, Tracker
from facestage.images.film import Film, Frame
from facestage.images.image_io import read_exr
from facestage.landmarks.finder import FaceFinder
from facestage.landmarks.model_file import open_model
from facestage.landmarks.tracker import FaceTracker
from facestage.models.registry import load_model
from facestage.render.variant import start_renderer, traces_here

LOOKS = 2
# Expectation maximisation over a course that is known.
ROUNDS = 20
PREPARED, FOUND, SEEN = 0.1, 0.2, 0.95  # where on the scale from 0 to 1 each part ends


@dataclass(frozen=True)
class RefitRequest:
    """What an artist asks for."""

    film: Path
    corrections: tuple[Correction, ...]
    frames: FrameRange | None = None  # None: around the corrected ones
    truth: Path | None = None
    landmark_model: Path | None = None
    device: str = "auto"


def refit(
    request: RefitRequest, out: Path, emit: Callable[[Event], None] = lambda event: None
) -> contract.Sequence:
    """Fit the frames around the corrected ones of the sequence ``out`` again, and write it anew.

    Raises InputError before anything is written.
    """
    out = Path(out).resolve()
    track = contract.Sequence.load(out)
    span = span_of(track, request.corrections, request.frames)
    with claimed(out, contract.FILE):
        run = _Refit(request, track, span, emit)
        found = run.run()
        with atomic_folder(out, is_result_file) as folder:
            run.write(folder, found)
    run.tell(DONE, "done", 1.0, found.advice)
    return replace(found, folder=out)


class _Refit:
    """From a sequence to the same one, corrected."""

    def __init__(
        self,
        request: RefitRequest,
        track: contract.Sequence,
        span: Span,
        emit: Callable[[Event], None],
    ) -> None:
        self.request, self.track, self.span, self._emit = request, track, span, emit
        rate = track.frame_rate if request.film.is_dir() else None
        self.film = Film(request.film, rate)
        self._began, self._cpu = time.monotonic(), time.process_time()

    def tell(self, kind: str, stage: str, fraction: float, words: str) -> None:
        """One event."""
        seconds = time.monotonic() - self._began
        left = seconds * (1 - fraction) / fraction if fraction > PREPARED else None
        told = Event(
            kind, stage, seconds=seconds, seconds_left=left, fraction=fraction, message=words
        )
        self._emit(told)

    def run(self) -> contract.Sequence:
        """All but the writing."""
        track, span = self.track, self.span
        self.tell(STARTED, "", 0.0, f"Reading {self.film.path.name}")
        model = load_model(track.model)
        if model.expression_names != track.expression_names:
            raise InputError(
                f"The face model '{track.model}' has other expressions than the sequence; it was "
                "another file when the film was tracked: track the film again."
            )
        truth = None
        if self.request.truth is not None:
            truth = SequenceTruth(self.request.truth, model, len(track.frames))
        start_renderer(self.request.device)
        self.tell(PROGRESS, "model", 0.02, "The person of the keyframes")
        actor = self._actor(model)
        self.tracker = Tracker(
            actor, self._landmarks(model), self._times[span.window], self._shots[span.window]
        )
        self.tracked = self._tracked(actor)
        keyed = self._looked()
        timings = {
            "refit": time.monotonic() - self._began,
            "refit_cpu": time.process_time() - self._cpu,
        }
        found = put_together(
            replace(track, film=str(self.film.path.absolute())),
            span,
            keyed,
            self.tracked,
            self._said,
            timings,
        )
        errors = {} if truth is None else truth.errors(actor.geometry.model, course_of(found))
        return replace(found, errors=errors)

    @property
    def _times(self) -> np.ndarray:
        return np.array([frame.time for frame in self.track.frames])

    @property
    def _shots(self) -> np.ndarray:
        return np.array([frame.shot for frame in self.track.frames])

    def _actor(self, model: FaceModel) -> Actor:
        """As the sequence had it."""
        folder = Path(str(self.track.folder)) / contract.KEYFRAMES
        folders = [folder / photo.folder for photo in Person.load(folder).photos]
        results = [Result.load(each) for each in folders]
        actor = Actor.of(model, results[0], read_exr(folders[0] / ALBEDO.file))
        if not self._compares:
            return actor
        landmarks = [known_to(model, Landmarks.read(each / LANDMARKS)) for each in folders]
        states = [
            actor.at(one.model_to_camera[:3, :3], one.model_to_camera[:3, 3], one.expression)
            for one in results
        ]
        numbers = [frame.number for frame in self.track.frames]
        wanted = {numbers.index(number) for number in self.track.keyframes}
        photographs = [
            frame.photograph
            for frame in self._frames(min(wanted), max(wanted) + 1)
            if frame.index in wanted
        ]
        return with_common_light(actor, photographs, landmarks, states)

    @property
    def _compares(self) -> bool:
        """Whether pictures were compared at all."""
        return any(frame.photo_rms is not None for frame in self.track.frames)

    def _frames(self, first: int, end: int) -> Iterator[Frame]:
        """Those of the film. Raises InputError for another film than the sequence is of."""
        for frame in self.film.frames(first):
            if frame.index >= end:
                return
            known = self.track.frames[frame.index]
            size = self.track.camera.width, self.track.camera.height
            if (frame.name, frame.photograph.size) != (known.name, size):
                raise InputError(
                    f"Frame {frame.index + 1} of '{self.film.path}' is '{frame.name}' of "
                    f"{frame.photograph.size[0]} x {frame.photograph.size[1]} pixels, that of the "
                    f"sequence '{known.name}' of {size[0]} x {size[1]}; give the film that was "
                    "tracked."
                )
            yield frame
        if first < end and frame.index + 1 < end:
            raise InputError(
                f"'{self.film.path}' ends after {frame.index + 1} frames, the sequence has "
                f"{len(self.track.frames)}; give the film that was tracked."
            )

    def _shown(self) -> Iterator[Frame]:
        """The frames that are looked at, counted from the first of the window."""
        start = self.span.window.start
        for frame in self._frames(self.span.first, self.span.end):
            yield replace(frame, index=frame.index - start)

    def _landmarks(self, model: FaceModel) -> list[Landmarks | None]:
        """Of the window; those that are held have none."""
        centre = self.track.camera.project(self.track.model_to_camera[self.span.first, None, :3, 3])
        found: list[Landmarks | None] = [None] * len(self.span.indices)
        for frame, landmarks in faces_of(self._shown(), centre, self.request.landmark_model):
            found[frame.index] = None if landmarks is None else known_to(model, landmarks)
            share = (frame.index + 1) / len(found)
            words = f"Finding the face: frame {frame.number}"
            self.tell(PROGRESS, "landmarks", PREPARED + (FOUND - PREPARED) * share, words)
        return found

    def _tracked(self, actor: Actor) -> Tracked:
        """The window as it was found."""
        track, window = self.track, self.span.window
        course = course_of(track)
        groups = groups_of(track.expression_names)
        whole = Motion.start(Triples.of(self._times, self._shots), groups)
        differences = whole.triples.differences(course)
        for _ in range(ROUNDS):
            whole = whole.learned(differences, np.zeros_like(differences))
        inside = np.isin(whole.triples.frames, self.span.indices).all(axis=1)
        triples = Triples.of(self._times[window], self._shots[window])
        own = Course(course.rotation[window], course.translation[window], course.expression[window])
        empty = np.full(len(own), np.nan)
        lights = None
        if track.light_radiance is not None:
            parameters = actor.forward.lights
            lights = np.array([parameters.from_radiance(one) for one in track.light_radiance])
            lights = lights[window]
        tracked = Tracked(
            own,
            replace(whole, triples=triples, weights=whole.weights[inside]),
            LandmarkBias(np.zeros((0, 2))),
            np.zeros((len(own), POSE + own.expression.shape[1])),
            empty,
            empty,
            lights,
        )
        return self.tracker.with_bias(tracked)

    def _looked(self) -> Keyed:
        """Look at the frames of the range, and smooth; again and again."""
        tracker, tracked, span = self.tracker, self.tracked, self.span
        keys = _keys(span, self.track, tracked.course)
        keyed = Keyed.begin(tracked.course, tracked.motion, keys, ~span.free)
        # A key may lie beyond what a fit would find.
        given = np.concatenate([keys.weights, tracked.course.expression])
        low = np.minimum(tracker.low, given.min(axis=0))
        high = np.maximum(tracker.high, given.max(axis=0))
        looks = LOOKS * int(span.free.sum()) if self._compares else 0
        crew = Crew.of(tracker.looker, looks) if looks and traces_here() else None
        looker = crew or tracker.looker
        try:
            for number in range(LOOKS):
                seen = replace(tracked, course=keyed.seen)
                pictures = None
                if looks:
                    pictures = tracker.no_pictures()
                    for answer in looker.answers(tracker.questions(seen, self._shown())):
                        tracker.heard(pictures, answer)
                        self._tell_of(number, answer.index)
                seen, said = tracker.said(seen, pictures)
                none = Evidence(np.zeros_like(said.hessian), np.zeros_like(said.gradient))
                prior = tracker.with_prior(keyed.course, none)
                keyed = keyed.improved(said, prior, low, high)
                self._said = said
                self.tracked = replace(seen, course=keyed.course)
        finally:
            if crew is not None:
                crew.end()
        return replace(keyed, course=keys.put_into(keyed.course))

    def _tell_of(self, number: int, index: int) -> None:
        free = np.flatnonzero(self.span.free)
        done = index - free[0] + 1
        share = (number + done / len(free)) / LOOKS
        words = f"Pictures, pass {number + 1} of {LOOKS}: frame {done} of {len(free)}"
        self.tell(PROGRESS, "pictures", FOUND + (SEEN - FOUND) * share, words)

    def write(self, folder: Path, track: contract.Sequence) -> None:
        """Write every file of the sequence into an existing folder."""
        self.tell(PROGRESS, "pictures", SEEN, "Writing the sequence")
        first = self.span.window.start
        wanted = some_of(self.span.first - first, self.span.end - 1 - first)
        shown = (frame for frame in self._shown() if frame.index in wanted)
        pictures = list(shown_frames(shown, self.tracker, self.tracked, track))
        write_again(folder, track, self.tracker.actor, pictures)


def faces_of(
    frames: Iterable[Frame], centre: Float[np.ndarray, "1 2"], landmark_model: Path | None
) -> Iterator[tuple[Frame, Landmarks | None]]:
    """The landmarks of the face that is at ``centre`` (pixels) in the first of ``frames``, if it is
    to be found, in each of them.
    """
    tracker = FaceTracker(FaceFinder(open_model(landmark_model)))
    tracker.resume(centre, 1)
    for frame in frames:
        face = tracker.look(frame.photograph).face
        yield frame, None if face is None else face.landmarks


def _keys(span: Span, track: contract.Sequence, course: Course) -> Keys:
    """The corrections of the window's frames."""
    size = course.expression.shape[1]
    known = np.zeros((len(course), POSE + size), bool)
    keys = Keys(known, course.expression.copy(), course.rotation.copy(), course.translation.copy())
    numbers: Sequence[int] = [track.frames[index].number for index in span.indices]
    for each in span.corrections:
        if each.frame not in numbers:
            continue
        place = numbers.index(each.frame)
        for name, value in each.weights.items():
            column = track.expression_names.index(name)
            known[place, POSE + column], keys.weights[place, column] = True, value
        if each.model_to_camera is not None:
            known[place, :POSE] = True
            keys.rotation[place] = each.model_to_camera[:3, :3]
            keys.translation[place] = each.model_to_camera[:3, 3]
    return keys
