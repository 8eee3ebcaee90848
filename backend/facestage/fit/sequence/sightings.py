"""The landmarks of all frames, found one after another."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel
from facestage.contract.files.partial import SEQUENCE_LANDMARKS
from facestage.contract.files.storage import read_arrays, write_arrays
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.detection import known_to
from facestage.images.film import FRAMES_MIN, Film, Frame
from facestage.landmarks.finder import SCHEME, FaceFinder
from facestage.landmarks.model_file import open_model
from facestage.landmarks.tracker import FaceTracker, Sight

SAVED_EVERY = 64  # frames
POINTS = 478


@dataclass
class Sightings:
    """What was found so far, frame by frame."""

    numbers: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    names: list[str] = field(default_factory=list)
    points: list[np.ndarray] = field(default_factory=list)  # (478, 2) pixels; NaN: no face
    visible: list[np.ndarray] = field(default_factory=list)  # (478,) bool
    confidence: list[float] = field(default_factory=list)  # 0: no face
    sights: list[Sight] = field(default_factory=list)
    size: tuple[int, int] = (0, 0)  # of the frames: width, height
    scheme: str = SCHEME

    def __len__(self) -> int:
        return len(self.numbers)

    def add(self, frame: Frame, tracker: FaceTracker) -> None:
        """Look at the next frame."""
        sighting = tracker.look(frame.photograph)
        face = sighting.face
        self.size = frame.photograph.size
        self.numbers.append(frame.number)
        self.times.append(frame.time)
        self.names.append(frame.name)
        self.points.append(np.full((POINTS, 2), np.nan) if face is None else face.landmarks.points)
        self.visible.append(np.zeros(POINTS, bool) if face is None else face.visible)
        self.confidence.append(0.0 if face is None else face.confidence)
        self.sights.append(sighting.sight)

    def landmarks(self, model: FaceModel) -> list[Landmarks | None]:
        """Of each frame, in a scheme that the model knows; None: no face."""
        return [
            known_to(model, Landmarks(self.scheme, points, visible))
            if sight != Sight.LOST
            else None
            for points, visible, sight in zip(self.points, self.visible, self.sights, strict=True)
        ]

    @property
    def shots(self) -> np.ndarray:
        """(F,) int, 1, 2, ...: frames of one number follow each other without a cut."""
        return 1 + np.cumsum([sight == Sight.CUT for sight in self.sights])

    def save(self, folder: Path, fingerprint: str) -> None:
        """Keep them for a run that goes on."""
        write_arrays(
            folder / SEQUENCE_LANDMARKS,
            {
                "fingerprint": np.array(fingerprint),
                "numbers": np.array(self.numbers, np.int64),
                "times": np.array(self.times),
                "names": np.array(self.names),
                "points": np.array(self.points),
                "visible": np.array(self.visible),
                "confidence": np.array(self.confidence),
                "sights": np.array([str(sight) for sight in self.sights]),
                "size": np.array(self.size),
                "scheme": np.array(self.scheme),
            },
            compress=False,
        )

    @classmethod
    def load(cls, folder: Path, fingerprint: str) -> Sightings:
        """Those that an earlier run left, if any.

        Raises InputError for another film's, and for what is damaged.
        """
        path = folder / SEQUENCE_LANDMARKS
        if not path.is_file():
            return cls()
        arrays = read_arrays(path, "checkpoint")
        try:
            return cls._of(arrays, folder, fingerprint)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"The checkpoint '{path}' is damaged ({error}); start again without --resume."
            ) from error

    @classmethod
    def _of(cls, arrays: Mapping[str, np.ndarray], folder: Path, fingerprint: str) -> Sightings:
        if str(arrays["fingerprint"]) != fingerprint:
            raise InputError(
                f"The checkpoint in '{folder}' is of another film, or of other options; start "
                "again without --resume."
            )
        return cls(
            arrays["numbers"].tolist(),
            arrays["times"].tolist(),
            [str(name) for name in arrays["names"]],
            list(arrays["points"]),
            list(arrays["visible"]),
            arrays["confidence"].tolist(),
            [Sight(str(sight)) for sight in arrays["sights"]],
            tuple(arrays["size"].tolist()),
            str(arrays["scheme"]),
        )


def look_through(
    film: Film,
    found: Sightings,
    landmark_model: Path | None,
    face: int | None,
    keep: Callable[[Sightings], None],
    tell: Callable[[Sightings], None],
) -> Sightings:
    """The face in every frame of ``film`` after those ``found`` already.

    ``keep`` is called now and then, and at the end; ``tell`` after every frame. Raises InputError
    where hardly any frame shows a face.
    """
    tracker = FaceTracker(FaceFinder(open_model(landmark_model)), face)
    seen = [index for index, sight in enumerate(found.sights) if sight != Sight.LOST]
    if seen:
        tracker.resume(found.points[seen[-1]], len(found) - 1 - seen[-1])
    try:
        for frame in film.frames(len(found)):
            found.add(frame, tracker)
            tell(found)
            if len(found) % SAVED_EVERY == 0:
                keep(found)
    finally:
        if len(found):
            keep(found)
    shown = sum(sight != Sight.LOST for sight in found.sights)
    if shown < FRAMES_MIN:
        raise InputError(
            f"A face was found in {shown} of the {len(found)} frames of '{film.path}', expected "
            f"{FRAMES_MIN} at least; give a film that shows one, upright and not too small."
        )
    return found
