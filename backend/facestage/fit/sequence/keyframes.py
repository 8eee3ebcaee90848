"""A few frames that differ most in pose and expression, and the person that is fitted to them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.face_model import FaceModel
from facestage.contract.landmarks import Landmarks
from facestage.contract.person import Person
from facestage.contract.result import Result
from facestage.contract.texture_maps import ALBEDO
from facestage.fit.face.state import State
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.sequence_truth import SequenceTruth
from facestage.fit.sequence.sightings import Sightings
from facestage.fit.sequence.tracking import Tracker
from facestage.images.film import Frame
from facestage.images.image_io import read_exr

# Of the frames of a shot: the share whose landmarks may be kept out of the choice as its worst.
STRAYS = 0.02
# A frame that comes after a blink differs much, but shows no new person: pairs nearer than this
# share of what the first two differ by are not both taken.
SAME_SHARE = 0.15
NOTHING = 1e-6  # of the face's size


@dataclass(frozen=True, eq=False)
class Prepared:
    """What is known before frames are followed: where the face is in each, and the person."""

    model: FaceModel
    sightings: Sightings
    landmarks: list[Landmarks | None]
    keyframes: list[int]  # indices
    frames: list[Frame]  # of the keyframes
    person: Person
    results: list[Result]  # of the keyframes
    truth: SequenceTruth | None

    @property
    def shown(self) -> list[Landmarks]:
        """The keyframes' landmarks."""
        found = (self.landmarks[index] for index in self.keyframes)
        return [one for one in found if one is not None]

    def person_found(self) -> tuple[Actor, list[State]]:
        """The person in the first keyframe's light, and where the keyframes have the face."""
        folder = self.results[0].folder
        assert folder is not None
        actor = Actor.of(self.model, self.results[0], read_exr(folder / ALBEDO.file))
        states = [
            actor.at(one.model_to_camera[:3, :3], one.model_to_camera[:3, 3], one.expression)
            for one in self.results
        ]
        return actor, states

    def tracker(self, actor: Actor, freeze: Sequence[str], frames: slice = slice(None)) -> Tracker:
        """Follows the ``actor`` through the film, or through a part of its ``frames``."""
        times, shots = np.array(self.sightings.times), self.sightings.shots
        return Tracker(actor, self.landmarks[frames], times[frames], shots[frames], freeze)


def choose_keyframes(
    landmarks: Sequence[Landmarks | None], confidence: Sequence[float], count: int
) -> list[int]:
    """Indices of ``count`` frames at most, in order: the most usual one, then always the one that
    differs most from all that are chosen.
    """
    seen = [index for index, one in enumerate(landmarks) if one is not None]
    if not seen:
        return []
    forms = np.array([_form(one.points) for one in landmarks if one is not None])
    middle = np.median(forms, axis=0)
    away = _distance(forms, middle)
    sure = np.array([confidence[index] for index in seen])
    usable = (away <= np.quantile(away, 1.0 - STRAYS)) & (sure >= 0.9 * np.median(sure))
    usable = usable if usable.any() else np.ones(len(seen), bool)
    chosen = [int(np.where(usable, away, np.inf).argmin())]
    nearest, first = _distance(forms, forms[chosen[0]]), 0.0
    while len(chosen) < min(count, int(usable.sum())):
        candidate = int(np.where(usable, nearest, -1.0).argmax())
        first = first or float(nearest[candidate])
        if nearest[candidate] <= max(SAME_SHARE * first, NOTHING):
            break
        chosen.append(candidate)
        nearest = np.minimum(nearest, _distance(forms, forms[candidate]))
    return sorted(seen[index] for index in chosen)


def _form(points: Float[np.ndarray, "landmarks 2"]) -> Float[np.ndarray, "landmarks 2"]:
    """The points without place and size; turned heads and moving mouths change what is left."""
    centred = points - points.mean(axis=0)
    return np.asarray(centred / np.sqrt((centred**2).sum(axis=1).mean()))


def _distance(
    forms: Float[np.ndarray, "frames landmarks 2"], form: Float[np.ndarray, "landmarks 2"]
) -> Float[np.ndarray, " frames"]:
    return np.asarray(np.sqrt(((forms - form) ** 2).sum(axis=2).mean(axis=1)))
