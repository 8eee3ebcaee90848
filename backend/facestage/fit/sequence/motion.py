"""How a head and a face move: what is known of the next frame from those beside it.

Second differences in time are drawn from Student's t distribution, of one scale for each group of
unknowns (head, mouth, lids, ...): mostly small, now and then as large as a blink or a plosive. The
scales are those that make the sequence likeliest, found by expectation maximisation (Dempster,
Laird and Rubin 1977; for the t distribution Liu and Rubin 1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.arrays import Float, Int
from facestage.fit.sequence.course import Course

# Degrees of freedom of the t distribution: at 3, one second difference in 30 is larger than three
# of its scales.
FREEDOM = 3.0
# Scales where a sequence begins to be looked at, and the least that they come to: of rotation in
# radians, of place in metres, of weights. They begin wide: a blink that is smoothed away at first
# would never be seen again.
ROTATION, PLACE, DEPTH, MOUTH, LIDS, GAZE, REST = range(7)
SCALE_START = np.array([0.01, 0.001, 0.001, 0.1, 0.3, 0.1, 0.05])
SCALE_MIN = np.array([2e-4, 1e-5, 1e-5, 2e-3, 2e-3, 2e-3, 1e-3])
# Of an unknown's scale: as many second differences count as having had that of its group.
GROUP_COUNT = 8.0
# Expectation maximisation creeps where noise hides the motion: each round goes so many times as
# far.
STRIDE = 2.0
GROUP_NAMES = ("rotation", "place", "depth", "mouth", "lids", "gaze", "rest")
WORDS = {
    MOUTH: ("jaw", "mouth", "lip", "tongue", "chin"),
    LIDS: ("blink", "wink", "squint", "wide", "lid"),
    GAZE: ("eyelook", "gaze", "eye_look", "pupil"),
}


def groups_of(expression_names: Sequence[str]) -> Int[np.ndarray, " unknowns"]:
    """Which group each unknown of a frame belongs to: 6 of the pose, then the expressions."""
    found = [ROTATION] * 3 + [PLACE] * 2 + [DEPTH]
    for name in expression_names:
        plain = name.lower()
        kind = (group for group, words in WORDS.items() if any(word in plain for word in words))
        found.append(next(kind, REST))
    return np.array(found)


@dataclass(frozen=True, eq=False)
class Triples:
    """Frames whose second difference is known to be small: three neighbours of one shot."""

    frames: Int[np.ndarray, "triples 3"]
    factors: Float[np.ndarray, "triples 3"]  # 1, -2, 1 where frames are equally far apart

    @classmethod
    def of(cls, times: Float[np.ndarray, " frames"], shots: Int[np.ndarray, " frames"]) -> Triples:
        """``times`` in seconds; ``shots``: frames of one number follow each other without a cut."""
        first = np.arange(max(len(times) - 2, 0))
        frames = first[:, None] + np.arange(3)
        frames = frames[shots[frames[:, 0]] == shots[frames[:, 2]]] if len(frames) else frames
        usual = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
        step = np.maximum(np.diff(times[frames], axis=1) / max(usual, 1e-9), 0.1)
        before, after = 1.0 / step[:, 0], 1.0 / step[:, 1]
        return cls(frames, np.stack([before, -(before + after), after], axis=1))

    def differences(self, course: Course) -> Float[np.ndarray, "triples unknowns"]:
        """The second differences; of rotations, the change of the turn from frame to frame."""
        a, b, c = self.frames.T
        turns = Rotation.from_matrix(course.rotation)
        before = (turns[b] * turns[a].inv()).as_rotvec() if len(a) else np.zeros((0, 3))
        after = (turns[c] * turns[b].inv()).as_rotvec() if len(a) else np.zeros((0, 3))
        rotation = self.factors[:, 2:] * after - self.factors[:, :1] * before
        linear = np.concatenate([course.translation, course.expression], axis=1)
        return np.concatenate([rotation, self.applied(linear)], axis=1)

    def applied(
        self, values: Float[np.ndarray, "frames unknowns"]
    ) -> Float[np.ndarray, "triples unknowns"]:
        """The second differences of plain numbers."""
        return np.einsum("ki,kid->kd", self.factors, values[self.frames])


@dataclass(frozen=True, eq=False)
class Motion:
    """The prior of a sequence's motion."""

    triples: Triples
    groups: Int[np.ndarray, " unknowns"]
    scales: Float[np.ndarray, " unknowns"]
    weights: Float[np.ndarray, "triples unknowns"]  # of the t distribution

    @classmethod
    def start(cls, triples: Triples, groups: Int[np.ndarray, " unknowns"]) -> Motion:
        """Before anything of the sequence is known."""
        weights = np.ones((len(triples.frames), len(groups)))
        return cls(triples, groups, SCALE_START[groups], weights)

    @property
    def precision(self) -> Float[np.ndarray, "triples unknowns"]:
        """The inverse variances of the second differences."""
        return self.weights / self.scales**2

    def learned(
        self,
        differences: Float[np.ndarray, "triples unknowns"],
        variance: Float[np.ndarray, "triples unknowns"],
    ) -> Motion:
        """One step of expectation maximisation: ``differences`` with their ``variance``, given all
        frames under this prior.
        """
        squared = differences**2 + variance
        counted = self.weights * squared
        found = np.empty_like(self.scales)
        for group in np.unique(self.groups):
            own = self.groups == group
            usual = counted[:, own].mean() if counted.size else SCALE_START[group] ** 2
            total = counted[:, own].sum(axis=0) + GROUP_COUNT * usual
            found[own] = np.sqrt(total / (len(counted) + GROUP_COUNT))
        scales = self.scales * (found / self.scales) ** STRIDE
        scales = np.maximum(scales, SCALE_MIN[self.groups])
        weights = (FREEDOM + 1.0) / (FREEDOM + squared / scales**2)
        return replace(self, scales=scales, weights=weights)
