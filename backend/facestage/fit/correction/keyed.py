"""Frames between which an artist's keys are known: the likeliest course near the one that was
found.

What a film says of a weight is off by nearly the same in neighbouring frames, and far more sure of
itself than it should be. So a key that differs from what was found says how far off the film is
there, and about as much beside it: each unknown that was corrected has an error of the film beside
it, which moves as that unknown does, slowly where it is slow and for a moment in a blink. What the
frames say is said of the unknown with its error; how faces move, of the unknown without it. Frames
without a key nearby keep what was found, for what pulls there is taken as being in balance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.arrays import Bool, Float, Int
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.motion import Motion
from facestage.fit.sequence.smoother import Evidence, pulled, smooth

# Standard deviations of a key: of turn in radians, of place in metres, of weights.
KEY_TURN, KEY_PLACE, KEY_WEIGHT = 1e-5, 1e-6, 1e-5
# Standard deviation of such errors, as a share of what keys are off by: as small as it may be, and
# yet a film that is very sure of itself gives in. Off by so much at least: a key may stand where
# the film was right.
ERROR_SHARE = 0.1
OFF_MIN = np.array([0.01] * 3 + [0.002] * 3), 0.05
HELD = 1e-9  # standard deviation of what is held


@dataclass(frozen=True, eq=False)
class Keys:
    """What is known of some frames: ``values`` where ``known``, poses as ``poses``."""

    known: Bool[np.ndarray, "frames unknowns"]
    weights: Float[np.ndarray, "frames expressions"]
    rotation: Float[np.ndarray, "frames 3 3"]
    translation: Float[np.ndarray, "frames 3"]

    def off(self, course: Course) -> Float[np.ndarray, "frames unknowns"]:
        """The step that would bring ``course`` onto the keys; 0 where nothing is known."""
        turn = Rotation.from_matrix(self.rotation @ course.rotation.transpose(0, 2, 1)).as_rotvec()
        parts = turn, self.translation - course.translation, self.weights - course.expression
        return np.where(self.known, np.concatenate(parts, axis=1), 0.0)

    @property
    def corrected(self) -> Int[np.ndarray, " errors"]:
        """The unknowns that are known somewhere."""
        return np.flatnonzero(self.known.any(axis=0))

    def put_into(self, course: Course) -> Course:
        """``course`` with the keys to the last digit."""
        turned = self.known[:, :3].all(axis=1)[:, None, None]
        return Course(
            np.where(turned, self.rotation, course.rotation),
            np.where(self.known[:, 3:POSE], self.translation, course.translation),
            np.where(self.known[:, POSE:], self.weights, course.expression),
        )


@dataclass(frozen=True, eq=False)
class Keyed:
    """Frames beside their errors, looked at anew around where they are by now."""

    keys: Keys
    held: Bool[np.ndarray, " frames"]  # those that stay as they are
    course: Course
    errors: Float[np.ndarray, "frames errors"]
    motion: Motion  # of unknowns, then of errors
    spread: Float[np.ndarray, " errors"]  # standard deviation of an error
    # What pulled where the course was found.
    balance: Float[np.ndarray, "frames unknowns"] | None = None
    deviation: Float[np.ndarray, "frames unknowns"] | None = None

    @classmethod
    def begin(
        cls, course: Course, motion: Motion, keys: Keys, held: Bool[np.ndarray, " frames"]
    ) -> Keyed:
        """At the ``course`` that was found."""
        corrected = keys.corrected
        least = np.concatenate([OFF_MIN[0], np.full(course.expression.shape[1], OFF_MIN[1])])
        off = np.maximum(np.abs(keys.off(course)).max(axis=0), least)
        spread = ERROR_SHARE * off[corrected]
        both = replace(
            motion,
            groups=np.concatenate([motion.groups, motion.groups[corrected]]),
            scales=np.concatenate([motion.scales, motion.scales[corrected]]),
            weights=np.concatenate([motion.weights, motion.weights[:, corrected]], axis=1),
        )
        return cls(keys, held, course, np.zeros((len(course), len(corrected))), both, spread)

    @property
    def seen(self) -> Course:
        """Where the film has the frames: with its errors."""
        step = np.zeros_like(self.keys.known, dtype=float)
        step[:, self.keys.corrected] = self.errors
        return self.course.moved(step)

    def improved(
        self,
        said: Evidence,
        prior: Evidence,
        low: Float[np.ndarray, " expressions"],
        high: Float[np.ndarray, " expressions"],
    ) -> Keyed:
        """After one step, by what the frames ``said`` at :attr:`seen`, and what is known of weights
        (``prior``) at the course.
        """
        corrected, size = self.keys.corrected, self.keys.known.shape[1]
        everything = np.concatenate([np.arange(size), corrected])
        hessian = said.hessian[:, everything[:, None], everything]
        gradient = said.gradient[:, everything]
        hessian[:, :size, :size] += prior.hessian
        gradient[:, :size] += prior.gradient
        beside = np.arange(size, len(everything))
        hessian[:, beside, beside] += 1.0 / self.spread**2
        gradient[:, beside] += self.errors / self.spread**2
        whole = replace(
            self.course, expression=np.concatenate([self.course.expression, self.errors], axis=1)
        )
        balance = self.balance
        if balance is None:
            pull = self.motion.precision * self.motion.triples.differences(whole)
            balance = gradient + pulled(self.motion, pull, gradient.shape)
        gradient = gradient - balance
        sure = np.where(self.keys.known, 1.0 / self._key_deviation() ** 2, 0.0)
        each = np.arange(size)
        hessian[:, each, each] += sure
        gradient[:, :size] -= sure * self.keys.off(self.course)
        every = np.arange(len(everything))
        hessian[np.ix_(self.held, every, every)] += np.eye(len(every)) / HELD**2
        none = np.full(len(corrected), np.inf)
        low, high = np.concatenate([low, -none]), np.concatenate([high, none])
        found = smooth(whole, Evidence(hessian, gradient), self.motion, low, high, 0, 0.0)
        step = np.where(self.held[:, None], 0.0, found.step)
        return replace(
            self,
            course=self.course.moved(step[:, :size]),
            errors=self.errors + step[:, size:],
            balance=balance,
            deviation=found.deviation[:, :size],
        )

    def _key_deviation(self) -> Float[np.ndarray, " unknowns"]:
        weights = self.keys.known.shape[1] - POSE
        return np.array([KEY_TURN] * 3 + [KEY_PLACE] * 3 + [KEY_WEIGHT] * weights)
