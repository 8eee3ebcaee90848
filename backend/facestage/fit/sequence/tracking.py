"""From landmarks, then from pictures, to the course of a face: looks at all frames, and a smoother
in between.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.contract.landmarks import Landmarks
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import EXPRESSION_SIGMA
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.frame_light import MOVING_SHARE, LightEquations
from facestage.fit.sequence.frames import LIGHTS, Cut, FrameView, Seen, landmark_evidence
from facestage.fit.sequence.landmark_bias import LandmarkBias
from facestage.fit.sequence.looking import Answer, Looker, Question
from facestage.fit.sequence.motion import GAZE, LIDS, Motion, Triples, groups_of
from facestage.fit.sequence.pose_noise import with_honest_poses
from facestage.fit.sequence.smoother import LEARNING_ROUNDS, Evidence, smooth
from facestage.fit.stages.initialize import initial_pose
from facestage.images.film import Frame

# Looks at the landmarks of all frames: first alone, so that whatever moves is seen, then with the
# motion learned.
LOOSE_PASSES, LANDMARK_PASSES = 2, 6
# A frame that is explained worse than the median by more than this factor counts for less, by this
# power of what is beyond, and the report says so. Blinks and wide mouths are worse by less.
DOUBT, DOUBT_POWER = 2.5, 4.0
# What landmarks count for beside a picture: they are off by the same in many frames, and a scatter
# that is small does not say so. Those of lids and eyes count in full, for pictures compare skin.
BESIDE_PICTURE = 0.1
# Errors of neighbouring frames are alike, and the smoother takes them for independent: its weights
# are so many times as far off as it says, but no further than by their own frame alone.
ALIKE = 2.0
# In which order quarters of the pixels are looked at: the next one is across.
QUARTERS = (0, 3, 1, 2)


@dataclass(frozen=True, eq=False)
class Tracked:
    """Where all frames are by now, and what is known of how they are seen and how they move."""

    course: Course
    motion: Motion
    bias: LandmarkBias
    deviation: Float[np.ndarray, "frames unknowns"]
    landmark_rms: Float[np.ndarray, " frames"]  # NaN: no face
    photo_rms: Float[np.ndarray, " frames"]  # NaN: not compared
    # Parameters of each frame's light, once it is known to move; None: all have the actor's.
    lights: Float[np.ndarray, "frames lights"] | None = None

    def state(self, actor: Actor, index: int) -> State:
        """Of one frame."""
        course = self.course
        pose = course.rotation[index], course.translation[index]
        state = actor.at(*pose, course.expression[index])
        return state if self.lights is None else replace(state, lights=self.lights[index])

    def wants_all_pixels(self, number: int, passes: int) -> bool:
        """Of the look ``number`` of so many: the last one does, and light that moves always."""
        return number == passes - 1 or self.lights is not None

    @property
    def doubts(self) -> Float[np.ndarray, " frames"]:
        """How many times worse than the median each frame is explained, by landmarks or picture."""
        ratios = [
            rms / max(float(np.nanmedian(rms)), 1e-9)
            for rms in (self.landmark_rms, self.photo_rms)
            if np.isfinite(rms).any()
        ]
        return np.fmax.reduce(ratios) if ratios else np.zeros(len(self.course))


class Tracker:
    """One person through all frames."""

    def __init__(
        self,
        actor: Actor,
        landmarks: Sequence[Landmarks | None],
        times: Float[np.ndarray, " frames"],
        shots: Int[np.ndarray, " frames"],
        freeze: Sequence[str] = (),
    ) -> None:
        self.actor, self.landmarks, self.shots = actor, landmarks, shots
        self._skins: dict[int, np.ndarray] = {}
        self._trusts: dict[str, np.ndarray] = {}
        self._light_held = LIGHTS in freeze
        model = actor.geometry.model
        self._triples = Triples.of(times, shots)
        self._groups = groups_of(model.expression_names)
        box = model.expression_box
        self.low = np.where(box, 0.0, -np.inf)
        self.high = np.where(box, 1.0, np.inf)
        if "expression" in freeze:
            self.low, self.high = np.zeros(len(box)), np.zeros(len(box))
        self._sigma = np.where(box, EXPRESSION_SIGMA, 1.0)

    def by_landmarks(
        self, shown: Sequence[Landmarks], states: Sequence[State], tell: Callable[[int], None]
    ) -> Tracked:
        """All frames by their landmarks; what keyframes have ``shown`` where their ``states`` are
        says what these are off by on this person. ``tell`` is told of each pass.
        """
        bias = LandmarkBias.of(self.actor, shown, states)
        empty = np.full(len(self.landmarks), np.nan)
        course = self._start()
        motion = Motion.start(self._triples, self._groups)
        size = POSE + course.expression.shape[1]
        tracked = Tracked(course, motion, bias, np.zeros((len(course), size)), empty, empty)
        for number in range(LANDMARK_PASSES):
            rounds = 0 if number < LOOSE_PASSES else LEARNING_ROUNDS
            tracked = self.smoothed(tracked, None, rounds)
            tell(number + 1)
        return tracked

    def _start(self) -> Course:
        """Poses from landmarks in closed form, those of frames without from their neighbours."""
        geometry, camera = self.actor.geometry, self.actor.camera
        seen = [index for index, one in enumerate(self.landmarks) if one is not None]
        poses = [initial_pose(geometry, one, camera) for one in self.landmarks if one is not None]
        nearest = np.abs(np.arange(len(self.landmarks))[:, None] - seen).argmin(axis=1)
        rotation, translation = (np.array(part)[nearest] for part in zip(*poses, strict=True))
        return Course(rotation, translation, np.zeros((len(nearest), len(self.low))))

    @property
    def looker(self) -> Looker:
        """Who answers :meth:`questions`."""
        return Looker(self.actor, self._light_held)

    def questions(
        self, tracked: Tracked, frames: Iterable[Frame], look: int | None = None
    ) -> Iterator[Question]:
        """What the pictures of ``frames`` say where ``tracked`` has the face. ``look``: the number
        of one at a quarter of the pixels, of each frame another one than the time before and in the
        frame before; None: at all.
        """
        for frame in frames:
            if frame.index >= len(self.landmarks):
                return
            landmarks = self.landmarks[frame.index]
            if landmarks is None:
                yield Question(frame.index, None)
                continue
            yield Question(
                frame.index,
                Cut.of(frame.photograph, landmarks),
                tracked.state(self.actor, frame.index),
                self._skins.get(frame.index),
                None if look is None else QUARTERS[(frame.index + look) % len(QUARTERS)],
            )

    def heard(self, pictures: Pictures, answer: Answer) -> None:
        """Note what a frame said."""
        pictures.add(answer.index, answer.seen)
        if answer.skin is not None:
            self._skins[answer.index] = answer.skin

    def no_pictures(self) -> Pictures:
        """Before the first is looked at."""
        lights = 0 if self._light_held else len(self.actor.state.lights)
        return Pictures.none(len(self.landmarks), POSE + len(self.low), lights)

    def view(self, frame: Frame, actor: Actor | None = None) -> FrameView | None:
        """A frame as it is compared, to this tracker's ``actor`` or a copy; None: no face."""
        landmarks = self.landmarks[frame.index] if frame.index < len(self.landmarks) else None
        if landmarks is None:
            return None
        cut, skin = Cut.of(frame.photograph, landmarks), self._skins.get(frame.index)
        return FrameView.of(actor or self.actor, cut, skin)

    def smoothed(
        self, tracked: Tracked, pictures: Pictures | None, rounds: int = LEARNING_ROUNDS
    ) -> Tracked:
        """One step of all frames, by their landmarks and by what their ``pictures`` said."""
        tracked, evidence = self.said(tracked, pictures)
        evidence = self.with_prior(tracked.course, evidence)
        if rounds:
            evidence = with_honest_poses(tracked.course, evidence, self._seen_shots())
        found = smooth(tracked.course, evidence, tracked.motion, self.low, self.high, rounds)
        deviation = honest(found.deviation, evidence.hessian)
        tracked = replace(tracked, course=found.course, motion=found.motion, deviation=deviation)
        return tracked if pictures is None else self._relit(tracked, pictures.light, found.step)

    def said(self, tracked: Tracked, pictures: Pictures | None) -> tuple[Tracked, Evidence]:
        """What landmarks and ``pictures`` of all frames say, by how well each is explained; that is
        noted.
        """
        size = POSE + len(self.low)
        hessian = np.zeros((len(tracked.course), size, size))
        gradient = np.zeros((len(tracked.course), size))
        landmark_rms = np.full(len(tracked.course), np.nan)
        for index, landmarks in enumerate(self.landmarks):
            if landmarks is None:
                continue
            state = tracked.state(self.actor, index)
            own = tracked.bias.taken_from(landmarks, state)
            compared = pictures is not None and np.isfinite(pictures.rms[index])
            trust = self._beside_picture(own.scheme) if compared else None
            said = landmark_evidence(self.actor, own, state, tracked.bias.scale, trust)
            hessian[index], gradient[index] = said.hessian, said.gradient
            landmark_rms[index] = said.rms
        photo_rms = tracked.photo_rms
        if pictures is not None:
            light = pictures.light
            seen = light.eliminated(pictures.hessian, pictures.gradient, self._radiance)
            hessian += seen[0]
            gradient += seen[1]
            photo_rms = pictures.rms
        tracked = replace(tracked, landmark_rms=landmark_rms, photo_rms=photo_rms)
        doubted = np.minimum(1.0, DOUBT / np.maximum(tracked.doubts, 1e-9)) ** DOUBT_POWER
        doubted = np.nan_to_num(doubted, nan=1.0)
        hessian *= doubted[:, None, None]
        gradient *= doubted[:, None]
        return tracked, Evidence(hessian, gradient)

    def with_prior(self, course: Course, evidence: Evidence) -> Evidence:
        """``evidence``, in place, with what is known of weights before a film."""
        each = np.arange(POSE, evidence.gradient.shape[1])
        evidence.hessian[:, each, each] += 1.0 / self._sigma**2
        evidence.gradient[:, POSE:] += course.expression / self._sigma**2
        return evidence

    def _beside_picture(self, scheme: str) -> Float[np.ndarray, " landmarks"]:
        """What each landmark counts for beside a picture."""
        if scheme not in self._trusts:
            model = self.actor.geometry.model
            corners, weights = model.landmark_vertices(scheme)
            moved = np.einsum("mi,emix->emx", weights, model.expression_basis[:, corners])
            most = np.linalg.norm(moved, axis=2).argmax(axis=0)
            eyes = np.isin(self._groups[POSE:][most], (LIDS, GAZE))
            self._trusts[scheme] = np.where(eyes, 1.0, BESIDE_PICTURE)
        return self._trusts[scheme]

    def _relit(self, tracked: Tracked, said: LightEquations, step: np.ndarray) -> Tracked:
        """Under the lights that pictures ask for after a ``step``, if one light is not enough."""
        common = self.actor.state.lights
        if self._light_held or not said.cost.any():
            return tracked
        lights = tracked.lights
        present = np.tile(common, (len(step), 1)) if lights is None else lights
        share = float(np.median(said.explained(self._radiance)[said.cost > 0]))
        if lights is None and share < MOVING_SHARE:
            return tracked
        found = said.followed(present, common, step, self.shots, self._radiance)
        return replace(tracked, lights=found)

    @property
    def _radiance(self) -> float:
        """The mean of the common light's."""
        return max(float(self.actor.forward.lights.radiance(self.actor.state.lights).mean()), 1e-9)

    def _seen_shots(self) -> np.ndarray:
        """The shots, each frame without a face one of its own."""
        lost = np.array([one is None for one in self.landmarks])
        return np.where(lost, -1 - np.arange(len(lost)), self.shots)

    def with_bias(self, tracked: Tracked) -> Tracked:
        """With what the landmarks of all frames are off by on this person."""
        seen = [index for index, one in enumerate(self.landmarks) if one is not None]
        chosen = [one for one in self.landmarks if one is not None]
        states = [tracked.state(self.actor, index) for index in seen]
        return replace(tracked, bias=LandmarkBias.of(self.actor, chosen, states))


def honest(
    deviation: Float[np.ndarray, "frames unknowns"],
    hessian: Float[np.ndarray, "frames unknowns unknowns"],
) -> Float[np.ndarray, "frames unknowns"]:
    """Standard deviations of weights as they are, not as the smoother has them."""
    result = deviation.copy()
    result[:, POSE:] *= ALIKE
    for index in np.flatnonzero(np.einsum("tii->ti", hessian).all(axis=1)):
        own = np.sqrt(np.diag(np.linalg.pinv(hessian[index], hermitian=True)))
        result[index, POSE:] = np.minimum(result[index, POSE:], own[POSE:])
    return result


@dataclass(frozen=True, eq=False)
class Pictures:
    """What the pictures of all frames said at one course."""

    hessian: Float[np.ndarray, "frames unknowns unknowns"]
    gradient: Float[np.ndarray, "frames unknowns"]
    rms: Float[np.ndarray, " frames"]
    light: LightEquations

    @classmethod
    def none(cls, frames: int, unknowns: int, lights: int) -> Pictures:
        """Before the first is looked at."""
        return cls(
            np.zeros((frames, unknowns, unknowns)),
            np.zeros((frames, unknowns)),
            np.full(frames, np.nan),
            LightEquations.none(frames, lights, unknowns),
        )

    def add(self, index: int, seen: Seen | None) -> None:
        """What the picture of one frame says."""
        if seen is None:
            return
        self.hessian[index], self.gradient[index] = seen.said.hessian, seen.said.gradient
        self.rms[index] = seen.said.rms
        self.light.hessian[index] = seen.light.hessian[0]
        self.light.gradient[index] = seen.light.gradient[0]
        self.light.cross[index] = seen.light.cross[0]
        self.light.cost[index] = seen.light.cost[0]
