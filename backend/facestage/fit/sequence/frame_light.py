"""The light of single frames: as free as it has to be for a head to be where it is.

The light that explains all keyframes best explains no frame quite, least of all where the head has
turned, and what is left over moves the head. So each frame has lights of its own around those, as
unknowns that are eliminated. Only where frames ask for light that the keyframes' does not come near
is it followed through time, as a random walk.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from facestage.contract.arrays import Bool, Float, Int
from facestage.fit.solve.block_tridiagonal import BlockTridiagonal

# Standard deviations in mean radiances of the common light: of a frame's lights around where they
# are known to be; around the common ones where light moves; and from one frame to the next.
OWN_SIGMA, MOVED_SIGMA, WALK_SIGMA = 0.5, 4.0, 0.5
# What is left over is taken for noise; where light of its own takes most of it away, a frame's
# noise is less by so much, and by this at most.
SHARPER_MOST = 100.0
# Light moves where this share of what frames have left over is gone under light of their own.
MOVING_SHARE = 0.6
ACTIVE_SET_ROUNDS = 4


@dataclass(frozen=True, eq=False)
class LightEquations:
    """What pictures say of their lights: 0.5 l^T H l + g^T l + l^T C x by changes l of the lights
    and steps x of pose and expression, beside what they say of x alone.
    """

    hessian: Float[np.ndarray, "frames lights lights"]
    gradient: Float[np.ndarray, "frames lights"]
    cross: Float[np.ndarray, "frames lights unknowns"]
    cost: Float[np.ndarray, " frames"]  # half the weighted sum of squares, at l = x = 0

    @classmethod
    def none(cls, frames: int, lights: int, unknowns: int) -> LightEquations:
        """Before a picture is looked at."""
        return cls(
            np.zeros((frames, lights, lights)),
            np.zeros((frames, lights)),
            np.zeros((frames, lights, unknowns)),
            np.zeros(frames),
        )

    def eliminated(
        self,
        hessian: Float[np.ndarray, "frames unknowns unknowns"],
        gradient: Float[np.ndarray, "frames unknowns"],
        mean: float,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The equations by x of frames whose lights are what suits them best; ``mean`` radiance."""
        hessian, gradient = hessian.copy(), gradient.copy()
        kept = 1.0 - self.explained(mean)
        for index in np.flatnonzero(self.cost):
            cross = self.cross[index]
            prior = kept[index] / (OWN_SIGMA * mean) ** 2
            own = self.hessian[index] + prior * np.eye(len(cross))
            both = np.column_stack([cross, self.gradient[index]])
            less = cross.T @ cho_solve(cho_factor(own), both)
            hessian[index] -= less[:, :-1]
            gradient[index] -= less[:, -1]
        return hessian, gradient

    def explained(self, mean: float) -> Float[np.ndarray, " frames"]:
        """Which share of what each frame has left over is gone under whatever light."""
        loose = np.eye(self.gradient.shape[1]) / SHARPER_MOST / (OWN_SIGMA * mean) ** 2
        change = -np.linalg.solve(self.hessian + loose, self.gradient[..., None])[..., 0]
        gained = self._gained(self.gradient, change)
        return np.clip(gained / np.maximum(self.cost, 1e-12), 0.0, 1.0 - 1.0 / SHARPER_MOST)

    def _gained(
        self,
        gradient: Float[np.ndarray, "frames lights"],
        change: Float[np.ndarray, "frames lights"],
    ) -> Float[np.ndarray, " frames"]:
        gained = np.einsum("fl,fl->f", gradient, change)
        return np.asarray(-gained - 0.5 * np.einsum("fi,fij,fj->f", change, self.hessian, change))

    def followed(
        self,
        lights: Float[np.ndarray, "frames lights"],
        common: Float[np.ndarray, " lights"],
        step: Float[np.ndarray, "frames unknowns"],
        shots: Int[np.ndarray, " frames"],
        mean: float,
    ) -> Float[np.ndarray, "frames lights"]:
        """The likeliest lights through time, after a ``step`` from where the pictures were looked
        at under ``lights``.
        """
        own = np.eye(len(common)) / (MOVED_SIGMA * mean) ** 2
        walk = (np.diff(shots) == 0) / (WALK_SIGMA * mean) ** 2
        sharper = 1.0 / (1.0 - self.explained(mean))
        hessian = self.hessian * sharper[:, None, None]
        gradient = self.gradient + np.einsum("flx,fx->fl", self.cross, step)
        gradient = gradient * sharper[:, None]
        ties = np.zeros(len(lights))
        ties[:-1] += walk
        ties[1:] += walk
        diagonal = hessian + own + ties[:, None, None] * np.eye(len(common))
        # By the lights themselves, not by their changes.
        right = np.einsum("fij,fj->fi", hessian, lights) - gradient + own @ common
        return _at_least_zero(diagonal, walk, right)


def _at_least_zero(
    diagonal: Float[np.ndarray, "frames lights lights"],
    walk: Float[np.ndarray, " steps"],
    right: Float[np.ndarray, "frames lights"],
) -> Float[np.ndarray, "frames lights"]:
    """The solution without what would be negative, by an active set."""
    free: Bool[np.ndarray, "frames lights"] = np.ones(right.shape, bool)
    result = right
    ties = np.broadcast_to(-walk[:, None, None, None], (len(walk), 1, 1, right.shape[1]))
    for _ in range(ACTIVE_SET_ROUNDS):
        result = BlockTridiagonal(diagonal, ties, free).solve(right)
        if (result >= 0).all():
            break
        free &= result >= 0
    return np.maximum(result, 0.0)
