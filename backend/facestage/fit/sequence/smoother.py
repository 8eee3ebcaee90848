"""All frames as one least-squares problem: what each frame says, and how faces move in between.

Every frame brings its normal equations. Second differences tie three frames together, so frames go
in pairs: then each pair is tied to the next one alone, and the system is block-tridiagonal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.fit.sequence.course import POSE, Course
from facestage.fit.sequence.motion import Motion, Triples
from facestage.fit.solve.block_tridiagonal import BlockTridiagonal

PAIR = 2
ACTIVE_SET_ROUNDS = 6
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
    for _ in range(ACTIVE_SET_ROUNDS):
        before = problem.free
        step = problem.improved(motion, differences)
        if (problem.free == before).all():
            break
    variance = np.einsum("tii->ti", problem.covariance()[0])
    deviation = np.sqrt(np.maximum(_per_frame(variance, len(course)), 0.0))
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
        hessian, frames = self.evidence.hessian, len(self.step)
        gradient = self.evidence.gradient + pulled(
            motion, motion.precision * differences, self.step.shape
        )
        diagonal, lower = _blocks(hessian, motion, self.damping)
        held = np.where(self.free, 0.0, self.step)
        right = -_paired(gradient + _product(hessian, motion, held))
        mask = _paired(self.free.astype(float))
        # In place: a long film's take more memory than all else.
        for blocks, first in ((diagonal, 0), (lower, 1)):
            blocks *= mask[first:, :, None]
            blocks *= mask[: len(blocks), None]
        self._system = BlockTridiagonal(diagonal, lower)
        step = np.where(self.free, _per_frame(self._system.solve(right * mask), frames), self.step)
        outside = self.free & ((step < self.low - 1e-12) | (step > self.high + 1e-12))
        self.step = np.clip(step, self.low, self.high)
        # What lies on a bound and is pushed back inside is let go again.
        slope = gradient + _product(hessian, motion, self.step)
        wants = ~self.free & np.where(self.step <= self.low, slope < 0, slope > 0)
        self.free = (self.free & ~outside) | wants
        return self.step

    def covariance(self) -> tuple[np.ndarray, np.ndarray]:
        """Of the last step, see :meth:`BlockTridiagonal.covariance`."""
        assert self._system is not None
        return self._system.covariance()


def _blocks(
    hessian: Float[np.ndarray, "frames unknowns unknowns"], motion: Motion, damping: float
) -> tuple[np.ndarray, np.ndarray]:
    """The system's blocks of pairs of frames: on the diagonal, and below it."""
    frames, size = hessian.shape[:2]
    pairs = -(-frames // PAIR)
    diagonal = np.zeros((pairs, PAIR, size, PAIR, size))
    lower = np.zeros((max(pairs - 1, 0), PAIR, size, PAIR, size))
    number = np.arange(frames)
    unknown = np.arange(size)
    diagonal[number // PAIR, number % PAIR, :, number % PAIR, :] = hessian
    damped = damping * np.einsum("tii->ti", hessian)
    for each in number:
        diagonal[each // PAIR, each % PAIR, unknown, each % PAIR, unknown] += damped[each]
    precision = motion.precision
    for triple, factors, weight in zip(
        motion.triples.frames, motion.triples.factors, precision, strict=True
    ):
        for a, by_a in zip(triple, factors, strict=True):
            for b, by_b in zip(triple, factors, strict=True):
                block = (a // PAIR, a % PAIR, unknown, b % PAIR, unknown)
                if a // PAIR == b // PAIR:
                    diagonal[block] += by_a * by_b * weight
                elif a // PAIR > b // PAIR:
                    lower[(b // PAIR, *block[1:])] += by_a * by_b * weight
    if frames % PAIR:
        diagonal[-1, 1, unknown, 1, unknown] = 0.0
    width = PAIR * size
    return diagonal.reshape(pairs, width, width), lower.reshape(-1, width, width)


def _product(
    hessian: Float[np.ndarray, "frames unknowns unknowns"],
    motion: Motion,
    step: Float[np.ndarray, "frames unknowns"],
) -> Float[np.ndarray, "frames unknowns"]:
    """The system times a step, without its damping."""
    result = np.einsum("tij,tj->ti", hessian, step)
    pull = motion.precision * motion.triples.applied(step)
    return result + pulled(motion, pull, step.shape)


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
    own: Float[np.ndarray, "pairs width width"],
    beside: Float[np.ndarray, "links width width"],
    free: Bool[np.ndarray, "frames unknowns"],
) -> Float[np.ndarray, "triples unknowns"]:
    """Of each second difference, given everything; what is held at a bound has none."""
    size = free.shape[1]
    unknown = np.arange(size)
    own = own.reshape(len(own), PAIR, size, PAIR, size)
    beside = beside.reshape(len(beside), PAIR, size, PAIR, size)
    result = np.zeros((len(triples.frames), size))
    for k, (triple, factors) in enumerate(zip(triples.frames, triples.factors, strict=True)):
        for a, by_a in zip(triple, factors, strict=True):
            for b, by_b in zip(triple, factors, strict=True):
                first, second = min(a, b), max(a, b)
                blocks = own if first // PAIR == second // PAIR else beside
                block = blocks[first // PAIR, first % PAIR, unknown, second % PAIR, unknown]
                result[k] += by_a * by_b * np.where(free[a] & free[b], block, 0.0)
    return np.maximum(result, 0.0)


def _paired(values: Float[np.ndarray, "frames unknowns"]) -> Float[np.ndarray, "pairs width"]:
    frames, size = values.shape
    result = np.zeros((-(-frames // PAIR) * PAIR, size))
    result[:frames] = values
    return result.reshape(-1, PAIR * size)


def _per_frame(
    values: Float[np.ndarray, "pairs width"], frames: int
) -> Float[np.ndarray, "frames unknowns"]:
    return values.reshape(-1, values.shape[1] // PAIR)[:frames]
