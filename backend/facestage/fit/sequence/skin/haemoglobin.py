"""Blood in the skin that comes and goes: how much haemoglobin each frame shows more or less.

What is left over of a patch's log color y, of which frame by frame

    y = s + g d (phi b) + noise,

s being what is wrong with the texture there in all frames, g how much of the light comes from
below the surface, d the change of log albedo by haemoglobin (:func:`pigment_directions`), phi
smooth functions over the face (:mod:`surface_harmonics`) and b what is looked for. Shading and
highlights are wrong too, in their own colors: the noise's covariance of the three channels, which
the film itself shows, says how to look past them (weighted least squares). Through time b is a
random walk, as light is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float, Int
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.sequence.skin.patches import Patches, PatchSeen
from facestage.fit.solve.block_tridiagonal import BlockTridiagonal
from facestage.models.anatomy.skin import pigment_directions
from facestage.models.mesh.surface_harmonics import surface_harmonics

# A blush is as wide as a cheek, the twelve smoothest functions over the face are wider. What a film
# needs of them goes into a dozen mixtures.
HARMONICS, WRITTEN = 60, 12
# Of a face's coefficients: standard deviations, in those of a population's haemoglobin, of the
# evenest one, how they fall with frequency, and of a random walk through a second. A blush comes up
# in a second, by two.
SIGMA, FALL, WALK = 1.0, 0.7, 2.0
FIRST_ROUNDS, ROUNDS = 4, 8
# Pixels of a patch from which on more say no more, and below which it says nothing.
ENOUGH, FEW = 60.0, 5.0
# The share of frames in which a patch is seen that says whether anything changes.
SEEN_ENOUGH = 0.5
# Least standard deviations: of a channel's log color, and of a patch's haemoglobin.
CHANNEL_MIN, PATCH_MIN = 2e-3, 0.02
CAUCHY = 3.0
AFTER_MAX = 0.95
# Errors as wide as the face are not in what is left over: on a film of constant skin, coefficients
# are so many times as far off as patches that err by themselves would make them.
WIDE = 2.5
# Found is what exceeds its own deviation so many times somewhere, and is to be seen at all, in
# deviations of the population: six films of constant skin show 0.8 to 2.4 times by errors of their
# fits, four with a blush 2.9 to 4.1 (docs/sequences.md).
CLEAR, FLOOR = 2.65, 0.1


@dataclass(frozen=True, eq=False)
class Haemoglobin:
    """More or less than in the person's texture, in standard deviations of a population.

    ``harmonics``: functions of unit RMS over the face, by the model's vertices; ``color``: what one
    standard deviation adds to the log of linear RGB albedo; ``change``: RMS through time where
    it is clearest, ``noise``: how much of that may be none.
    """

    coefficients: Float[np.ndarray, "frames harmonics"]
    deviation: Float[np.ndarray, "frames harmonics"]
    harmonics: Float[np.ndarray, "harmonics vertices"]
    color: Float[np.ndarray, " 3"]
    change: float
    noise: float

    @property
    def is_clear(self) -> bool:
        """Whether there is more than noise and errors make."""
        return self.change > max(CLEAR * self.noise, FLOOR)


def haemoglobin(
    geometry: FaceGeometry,
    patches: Patches,
    frames: Sequence[PatchSeen | None],
    times: Float[np.ndarray, " frames"],
    shots: Int[np.ndarray, " frames"],
    keyframes: Sequence[int],
) -> Haemoglobin:
    """Of all ``frames`` (None: no face) at ``times`` in seconds, less that of the ``keyframes``,
    which the texture shows.
    """
    inside = geometry.fitted_vertices
    functions, values = surface_harmonics(
        geometry.mean, geometry.triangles[geometry.fitted], inside, HARMONICS
    )
    color = pigment_directions()[1]
    sigma = SIGMA * (1.0 + values / max(values[min(1, len(values) - 1)], 1e-30)) ** -FALL
    walk = (np.diff(shots) == 0) / (WALK**2 * np.maximum(np.diff(times), 1e-3))
    table = _Table.of(frames, patches.count)
    solver = _Solver(table, patches.means(functions), color, sigma, walk)
    coefficients, covariance = solver.solved()
    change, noise = solver.clearest(coefficients, covariance)
    coefficients -= coefficients[list(keyframes)].mean(axis=0)
    needed = np.linalg.svd(coefficients, full_matrices=False)[2][:WRITTEN]
    variance = np.einsum("mk,fkl,ml->fm", needed, covariance, needed, optimize=True)
    everywhere = np.zeros((len(needed), len(geometry.model.vertices)))
    everywhere[:, geometry.used] = needed @ functions
    return Haemoglobin(coefficients @ needed.T, np.sqrt(variance), everywhere, color, change, noise)


@dataclass(frozen=True, eq=False)
class _Table:
    """What all frames say, of each patch."""

    weight: Float[np.ndarray, "frames patches"]  # 0..1
    residual: Float[np.ndarray, "frames patches 3"]
    by_log_albedo: Float[np.ndarray, "frames patches 3"]

    @classmethod
    def of(cls, frames: Sequence[PatchSeen | None], patches: int) -> _Table:
        weight = np.zeros((len(frames), patches))
        residual, by_log_albedo = np.zeros((2, len(frames), patches, 3))
        for index, frame in enumerate(frames):
            if frame is not None:
                enough = np.minimum(frame.weight / ENOUGH, 1.0)
                weight[index] = np.where(frame.weight >= FEW, enough, 0.0)
                residual[index], by_log_albedo[index] = frame.residual, frame.by_log_albedo
        return cls(weight, residual, by_log_albedo)


@dataclass(eq=False)
class _Solver:
    table: _Table
    functions: Float[np.ndarray, "patches harmonics"]
    color: Float[np.ndarray, " 3"]
    sigma: Float[np.ndarray, " harmonics"]
    walk: Float[np.ndarray, " steps"]  # inverse variances of steps, over sigma^2

    def solved(self) -> tuple[np.ndarray, np.ndarray]:
        """(frames, harmonics) coefficients, 0 in the mean, and their covariance in each frame."""
        table, weight = self.table, self.table.weight
        change = table.by_log_albedo * self.color
        coefficients = np.zeros((len(weight), len(self.sigma)))
        covariance = np.zeros((*coefficients.shape, len(self.sigma)))
        for number in range(ROUNDS):
            shown = np.einsum("pk,fk->fp", self.functions, coefficients)[..., None] * change
            beyond = table.residual - shown
            beyond = beyond - _mean(beyond, weight)
            look = _filter(beyond, weight > 0, self.color)
            # In standard deviations of haemoglobin, and what is left of these.
            left, gain = beyond @ look, change @ look
            scale = np.sqrt(_mean(left**2, self.table.weight > 0) + PATCH_MIN**2)
            robust = 1.0 / (1.0 + (left / (CAUCHY * scale)) ** 2)
            weight = self.table.weight * robust
            right = (shown @ look) + left
            said = weight / scale**2
            # At first what changes is still left over, and alike from frame to frame.
            if number >= FIRST_ROUNDS:
                said = said / self._alike(left / scale, weight > 0)
            coefficients, covariance = self._smoothed(said, right, gain)
        return coefficients, covariance

    def clearest(
        self,
        coefficients: Float[np.ndarray, "frames harmonics"],
        covariance: Float[np.ndarray, "frames harmonics harmonics"],
    ) -> tuple[float, float]:
        """RMS through time and its standard deviation, at the patch where it is clearest."""
        functions = self.functions[(self.table.weight > 0).mean(axis=0) > SEEN_ENOUGH]
        if not len(functions):
            return 0.0, 0.0
        change = np.sqrt(((coefficients @ functions.T) ** 2).mean(axis=0))
        noise = np.sqrt(np.einsum("pk,kl,pl->p", functions, covariance.mean(axis=0), functions))
        where = int((change / noise).argmax())
        return float(change[where]), float(noise[where])

    def _alike(
        self, left: Float[np.ndarray, "frames patches"], seen: Bool[np.ndarray, "frames patches"]
    ) -> float:
        """How many frames say no more than one, for the next errs alike: by its correlation r,
        (1 + r) / (1 - r).
        """
        left = np.where(seen, left, 0.0)
        both = seen[1:] & seen[:-1]
        power = 0.5 * ((left[1:] ** 2 + left[:-1] ** 2) * both).sum()
        after = float(np.clip((left[1:] * left[:-1]).sum() / max(power, 1e-12), 0.0, AFTER_MAX))
        return (1.0 + after) / (1.0 - after)

    def _smoothed(
        self,
        said: Float[np.ndarray, "frames patches"],
        right: Float[np.ndarray, "frames patches"],
        gain: Float[np.ndarray, "frames patches"],
    ) -> tuple[np.ndarray, np.ndarray]:
        """The likeliest coefficients through time of ``right`` = gain phi b."""
        functions = self.functions
        hessian = np.einsum("fp,pk,pl->fkl", said * gain**2, functions, functions, optimize=True)
        gradient = (said * gain * right) @ functions
        ties = np.zeros(len(said))
        ties[:-1] += self.walk
        ties[1:] += self.walk
        each = np.arange(len(self.sigma))
        hessian[:, each, each] += (1.0 + ties[:, None]) / self.sigma**2
        across = (-self.walk[:, None] / self.sigma**2)[:, None, None]
        system = BlockTridiagonal(hessian, across, np.ones(gradient.shape, bool))
        coefficients = system.solve(gradient)
        return coefficients - coefficients.mean(axis=0), WIDE**2 * system.diagonal_blocks()


def _mean(
    values: Float[np.ndarray, "frames patches ..."], weight: Float[np.ndarray, "frames patches"]
) -> np.ndarray:
    """Over the frames, of each patch."""
    weight = weight.reshape(weight.shape + (1,) * (values.ndim - 2))
    return (weight * values).sum(axis=0) / np.maximum(weight.sum(axis=0), 1e-9)


def _filter(
    values: Float[np.ndarray, "frames patches 3"],
    seen: Bool[np.ndarray, "frames patches"],
    color: Float[np.ndarray, " 3"],
) -> Float[np.ndarray, " 3"]:
    """Which mixture of the channels shows 1 where ``color`` is added, and least of the rest."""
    found = values[seen]
    covariance = found.T @ found / max(len(found), 1) + CHANNEL_MIN**2 * np.eye(3)
    look = np.linalg.solve(covariance, color)
    return look / (look @ color)
