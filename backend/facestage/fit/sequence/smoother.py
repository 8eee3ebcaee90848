"""All frames as one least-squares problem: what each frame says, and how faces move in between.

Every frame brings its normal equations. Second differences tie three frames together, so frames go
in pairs: then each pair is tied to the next one alone, and the system is block-tridiagonal.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np

from facestage.contract.arrays import Bool, Float, Shaped
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.motion import Motion, Triples
from facestage.fit.solve.block_tridiagonal import BlockTridiagonal

PAIR = 2
# Rounds that mend the active set, after those of learning: these mend it too.
ACTIVE_SET_ROUNDS, AFTER_LEARNING = 6, 3
# Expectation maximisation between two looks at the frames.
LEARNING_ROUNDS = 8
DAMPING = 1e-3


@dataclass(frozen=True, eq=False)
class Evidence:
    """What frames say at a course: 0.5 x^T H x + g^T x by steps x, their own priors included."""

    hessian: Float[np.ndarray, "frames unknowns unknowns"]
    gradient: Float[np.ndarray, "frames unknowns"]


@dataclass(frozen=True, eq=False)
class Smoothed:
    """The likeliest course under what the frames said, and how sure it is."""

    course: Course
    motion: Motion
    deviation: Float[np.ndarray, "frames unknowns"]  # standard deviations; 0 at a bound
    step: Float[np.ndarray, "frames unknowns"]  # to the course from where it was


def smooth(
    course: Course,
    evidence: Evidence,
    motion: Motion,
    low: Float[np.ndarray, " expressions"],
    high: Float[np.ndarray, " expressions"],
    rounds: int = LEARNING_ROUNDS,
    damping: float = DAMPING,
) -> Smoothed:
    """One step of all frames from ``course``, their weights kept within ``low`` and ``high``, the
    motion's scales learned in ``rounds``. ``damping``: of what a frame says in a direction, on top
    of it, for its equations hold near the state alone.
    """
    differences = motion.triples.differences(course)
    problem = _Bounded(course, evidence, low, high, damping)
    for _ in range(rounds):
        step = problem.improved(motion, differences)
        after = differences + motion.triples.applied(step)
        variance = _variances(motion.triples, *problem.covariance(), problem.free)
        motion = motion.learned(after, variance)
    for _ in range(AFTER_LEARNING if rounds else ACTIVE_SET_ROUNDS):
        before = problem.free
        step = problem.improved(motion, differences)
        if (problem.free == before).all():
            break
    variance = np.einsum("tiiu->tiu", problem.covariance()[0])
    deviation = np.sqrt(np.maximum(variance.reshape(-1, variance.shape[-1])[: len(course)], 0.0))
    return Smoothed(course.moved(step), motion, np.where(problem.free, deviation, 0.0), step)


class _Bounded:
    """The step of all frames within bounds, by an active set that is mended from call to call."""

    def __init__(
        self,
        course: Course,
        evidence: Evidence,
        low: Float[np.ndarray, " expressions"],
        high: Float[np.ndarray, " expressions"],
        damping: float,
    ) -> None:
        self.evidence, self.damping = evidence, damping
        frames, size = evidence.gradient.shape
        self.low, self.high = np.full((frames, size), -np.inf), np.full((frames, size), np.inf)
        self.low[:, POSE:], self.high[:, POSE:] = low - course.expression, high - course.expression
        self.free = np.ones((frames, size), bool)
        self.step = np.zeros((frames, size))
        self._system: BlockTridiagonal | None = None

    def improved(
        self, motion: Motion, differences: Float[np.ndarray, "triples unknowns"]
    ) -> Float[np.ndarray, "frames unknowns"]:
        """The step under ``motion`` with what is free so far; what goes beyond its bounds is held
        there the next time.
        """
        self._system = None  # or there are two of them for a while
        gradient = self.evidence.gradient + pulled(
            motion, motion.precision * differences, self.step.shape
        )
        held = np.where(self.free, 0.0, self.step)
        right = -_paired(gradient + self._product(motion, held))
        within, across = _ties(motion, len(self.step))
        self._system = BlockTridiagonal(self._blocks(within), across, _paired(self.free))
        found = _per_frame(self._system.solve(right), len(self.step))
        step = np.where(self.free, found, self.step)
        outside = self.free & ((step < self.low - 1e-12) | (step > self.high + 1e-12))
        self.step = np.clip(step, self.low, self.high)
        # What lies on a bound and is pushed back inside is let go again.
        slope = gradient + self._product(motion, self.step)
        wants = ~self.free & np.where(self.step <= self.low, slope < 0, slope > 0)
        self.free = (self.free & ~outside) | wants
        return self.step

    def _blocks(
        self, within: Float[np.ndarray, "pairs 2 2 unknowns"]
    ) -> Iterator[Float[np.ndarray, "width width"]]:
        """The system's blocks of pairs of frames, ``within`` which frames are tied so."""
        hessian = self.evidence.hessian
        size = hessian.shape[1]
        each = np.arange(size)
        for pair, ties in enumerate(within):
            block = np.zeros((PAIR, size, PAIR, size))
            for number, own in enumerate(hessian[PAIR * pair : PAIR * (pair + 1)]):
                block[number, :, number] = own
                block[number, each, number, each] += self.damping * own.diagonal()
            block[:, each, :, each] += ties.transpose(2, 0, 1)
            yield block.reshape(PAIR * size, -1)

    def _product(
        self, motion: Motion, step: Float[np.ndarray, "frames unknowns"]
    ) -> Float[np.ndarray, "frames unknowns"]:
        """The system times a step, without its damping."""
        result = (self.evidence.hessian @ step[..., None])[..., 0]
        pull = motion.precision * motion.triples.applied(step)
        return result + pulled(motion, pull, step.shape)

    def covariance(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the last step, see :meth:`BlockTridiagonal.covariance`."""
        assert self._system is not None
        return self._system.covariance()


def _ties(
    motion: Motion, frames: int
) -> tuple[Float[np.ndarray, "pairs 2 2 unknowns"], Float[np.ndarray, "links 2 2 unknowns"]]:
    """What second differences add between an unknown and itself: to the diagonal blocks of the
    pairs of so many frames, and to those below.
    """
    precision = motion.precision
    pairs = -(-frames // PAIR)
    within = np.zeros((pairs, PAIR, PAIR, precision.shape[1]))
    across = np.zeros((max(pairs - 1, 0), *within.shape[1:]))
    for (a, by_a), (b, by_b) in product(_corners(motion.triples), repeat=2):
        added = (by_a * by_b)[:, None] * precision
        same, below = a // PAIR == b // PAIR, a // PAIR > b // PAIR
        for blocks, some in ((within, same), (across, below)):
            place = b[some] // PAIR, a[some] % PAIR, b[some] % PAIR
            np.add.at(blocks, place, added[some])
    return within, across


def _corners(triples: Triples) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The first, middle and last frame of all triples, and their factors."""
    return zip(triples.frames.T, triples.factors.T, strict=True)


def pulled(
    motion: Motion, pull: Float[np.ndarray, "triples unknowns"], shape: tuple[int, ...]
) -> Float[np.ndarray, "frames unknowns"]:
    """What ``pull`` on each second difference is on the frames."""
    result = np.zeros(shape)
    for corner in range(3):
        factor = motion.triples.factors[:, corner, None]
        np.add.at(result, motion.triples.frames[:, corner], factor * pull)
    return result


def _variances(
    triples: Triples,
    own: Float[np.ndarray, "pairs 2 2 unknowns"],
    beside: Float[np.ndarray, "links 2 2 unknowns"],
    free: Bool[np.ndarray, "frames unknowns"],
) -> Float[np.ndarray, "triples unknowns"]:
    """Of each second difference, given everything; what is held at a bound has none."""
    result = np.zeros((len(triples.frames), own.shape[-1]))
    for (a, by_a), (b, by_b) in product(_corners(triples), repeat=2):
        first, second = np.minimum(a, b), np.maximum(a, b)
        same = first // PAIR == second // PAIR
        for blocks, some in ((own, same), (beside, ~same)):
            place = first[some] // PAIR, second[some] % PAIR, first[some] % PAIR
            factor = (by_a * by_b)[some, None] * (free[a] & free[b])[some]
            result[some] += factor * blocks[place]
    return np.maximum(result, 0.0)


def _paired(values: Shaped[np.ndarray, "frames unknowns"]) -> Shaped[np.ndarray, "pairs width"]:
    frames, size = values.shape
    result = np.zeros((-(-frames // PAIR) * PAIR, size), values.dtype)
    result[:frames] = values
    return result.reshape(-1, PAIR * size)


def _per_frame(
    values: Float[np.ndarray, "pairs width"], frames: int
) -> Float[np.ndarray, "frames unknowns"]:
    return values.reshape(-1, values.shape[1] // PAIR)[:frames]
