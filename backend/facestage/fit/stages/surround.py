"""Light from behind: whether a photo shows any, found before the first light is fitted.

The stage's lights stand in front of the face, where a lamp says most of its shape. A sky, a window
or a rim lamp behind the head light its sides too. Given the landmarks' face of mean skin, the photo
is linear in the lights: it is explained twice by non-negative least squares, with the stage's
lights and with as many again behind, and what these gain is counted in the energy of the photo
term, so by the noise that the photo shows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls

from facestage.contract.arrays import Bool, Float
from facestage.contract.job import AUTO, Job
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.face.state import State

# Of the photo's energy, from which on lights behind are worth their parameters. Photographs lit
# from in front gain 0 to 28 by what such lights explain of wrong albedo and shape (30 with a hand
# before the face), those with rims of light and under skies 76 to 400.
GAIN_MIN = 40.0
# Least squares without negative lights leaves most of them dark: how many join at most, and the
# share of the radiance from which on one does.
LIGHTS_MOST, SHARE_MIN = 16, 0.001
ROUNDS = 3  # of noise and light in turn
FLOOR_SHARE = 0.15  # of the mean radiance, in the first round's weights


@dataclass(frozen=True)
class Surround:
    """What lights behind the face would explain of a photo."""

    lights: tuple[int, ...]  # their numbers among those of lights_behind
    gain: float  # of the photo's energy
    share: float  # of the light on the face that would come from them
    joined: bool  # they are fitted

    @property
    def words(self) -> str:
        """Why they joined, or did not."""
        asked = "" if self.joined == (self.gain >= GAIN_MIN) else "the job asks for them; "
        return (
            f"{asked}they lower the first guess's energy by {self.gain:.1f}, from {GAIN_MIN:g} on "
            f"it is no misfit, and would give {self.share:.0%} of the light on the face"
        )


def look_behind(photo: PhotoTerm, scaled: State, behind: int, job: Job) -> Surround:
    """What the last ``behind`` lights of the ``photo`` term's stage would explain at ``scaled``, a
    state at the size of its phase, and whether the ``job`` has them join.
    """
    gain, share = _gain(photo, photo.evaluate(scaled, job.seed), behind)
    brightest = np.argsort(-share)[: max(1, min(LIGHTS_MOST, int((share >= SHARE_MIN).sum())))]
    lights = tuple(sorted(brightest.tolist()))
    joins = job.surround != AUTO or gain >= GAIN_MIN
    return Surround(lights, gain, float(share.sum()), joins)


def _gain(
    photo: PhotoTerm, evaluation: Evaluation, behind: int
) -> tuple[float, Float[np.ndarray, " behind"]]:
    """By how much the last ``behind`` of the lights lower the photo's energy, and the share of each
    in the radiance.
    """
    image = evaluation.image
    y, x = photo.index(image.surface)
    problem = _Channels(
        image.skin.by_lights(
            image.terms.diffuse,
            image.terms.specular,
            indirect=image.terms.indirect,
            scattered=image.scattered,
        ),
        photo.photo.color[y, x],
        photo.photo.clipped[y, x],
    )
    if not len(y):
        return 0.0, np.zeros(behind)
    front = np.arange(problem.columns.shape[2]) < problem.columns.shape[2] - behind
    level = problem.target.mean(axis=1)
    weights = evaluation.base_weight[y, x] / (level + FLOOR_SHARE * level.mean() + 1e-12) ** 2
    for _ in range(ROUNDS):
        residual = np.zeros_like(evaluation.residual)
        residual[y, x] = problem.residual(problem.radiance(front, weights))
        shown = replace(evaluation, residual=residual)
        noise = photo.noise(shown)
        weights = photo.weights(shown, noise)[y, x]
    # Not robust: rims that the stage's lights cannot make look like something in the way.
    matte = replace(noise, excess=np.ones_like(noise.excess))
    scale = matte.scale(photo.photo.color, residual, np.zeros_like(evaluation.highlight))[y, x, 0]
    weights = noise.information() * evaluation.base_weight[y, x] / scale**2
    energies, radiance = [], np.zeros((3, len(front)))
    for lights in (front, np.ones_like(front)):
        radiance = problem.radiance(lights, weights)
        energies.append(0.5 * float((weights[:, None] * problem.residual(radiance) ** 2).sum()))
    flux = np.einsum("cpl,cl->l", problem.columns, radiance)
    return energies[0] - energies[1], flux[~front] / max(float(flux.sum()), 1e-30)


@dataclass(frozen=True)
class _Channels:
    """The photo as a linear function of the lights, channel by channel."""

    columns: Float[np.ndarray, "3 pixels lights"]
    target: Float[np.ndarray, "pixels 3"]
    clipped: Bool[np.ndarray, "pixels 3"]

    def radiance(
        self, lights: Bool[np.ndarray, " lights"], weights: Float[np.ndarray, " pixels"]
    ) -> Float[np.ndarray, "3 lights"]:
        """Of the ``lights``, the best; of all others 0."""
        result = np.zeros((3, len(lights)))
        for channel in range(3):
            columns, target = self.columns[channel][:, lights], self.target[:, channel]
            clipped = self.clipped[:, channel]
            counted = np.ones_like(clipped)
            for _ in range(ROUNDS if clipped.any() else 1):
                root = np.sqrt(weights * counted)
                found = _nnls(columns * root[:, None], root * target)
                # A clipped pixel says "at least this bright".
                counted = ~clipped | (columns @ found < target)
            result[channel, lights] = found
        return result

    def residual(self, radiance: Float[np.ndarray, "3 lights"]) -> Float[np.ndarray, "pixels 3"]:
        """Model minus photo, 0 where the photo is clipped and the model brighter."""
        difference = np.einsum("cpl,cl->pc", self.columns, radiance) - self.target
        return np.where(self.clipped & (difference > 0), 0.0, difference)


def _nnls(
    columns: Float[np.ndarray, "pixels lights"], target: Float[np.ndarray, " pixels"]
) -> Float[np.ndarray, " lights"]:
    """By the normal equations' triangle: a tenth of the time for many pixels."""
    triangle = np.asarray(np.linalg.qr(np.column_stack([columns, target]), mode="r"))
    found, _ = nnls(triangle[:, :-1], triangle[:, -1], maxiter=100 * columns.shape[1])
    return np.asarray(found)
