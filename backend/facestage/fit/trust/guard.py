"""Whether the photo may be believed about the shape, after the fit: if not, the landmarks' shape is
kept.

The landmark phase ends at the maximum of its posterior, whose curvature there says how far the true
shape may lie. In its own units that squared distance, here twice the rise of the landmarks' and the
priors' energy (Wilks 1938), is chi-squared with as many degrees of freedom as the shape has
parameters. A photo that pulls the shape beyond what chance allows contradicts the landmarks or is
not of a face; so does one that the fitted face does not explain at all.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.special import gammaincinv

from facestage.fit.energy.energy import Energy
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.face.state import State
from facestage.fit.given.photo import Photo

# Chance that a true shape lies beyond the limit.
CHANCE = 1e-3
# PSNR in dB below which a render is not a picture of what the photo shows.
EXPLAINED_MIN_DB = 15.0
# Share of the face's pixels that must be neither black nor saturated for the photo to say anything
# of the shape.
INFORMATIVE_SHARE_MIN = 0.2


def landmark_statistic(energy: Energy, start: State, end: State) -> float:
    """Twice the rise of landmark and shape prior energy from ``start``, the landmark phase's state,
    to ``end``.

    ``energy``: the landmark phase's, at the photo's own size.
    """
    before, after = (energy.at(state).robust(state) for state in (start, end))
    return 2.0 * (_of_shape(after) - _of_shape(before) + after["focal"] - before["focal"])


def landmark_energy(energy: Energy, state: State) -> float:
    """Energy of landmarks and shape priors; robust, so that a wrong landmark weighs little."""
    return _of_shape(energy.at(state).robust(state))


def _of_shape(energies: Mapping[str, float]) -> float:
    observed = energies["landmarks"] + energies.get("pins", 0.0)
    return observed + energies["identity"] + energies["expression"]


def statistic_limit(parameters: int) -> float:
    """What :func:`landmark_statistic` exceeds with a chance of CHANCE, for so many free shape
    parameters.
    """
    # The quantile of chi-squared; scipy.stats has it too, but takes half a second to import.
    return 2.0 * float(gammaincinv(0.5 * max(parameters, 1), 1.0 - CHANCE))


def informative_share(photo: Photo, evaluation: Evaluation) -> float:
    """Share of the rendered skin's usable pixels that are neither black nor saturated in every
    channel.
    """
    surface = evaluation.image.surface
    column, row = surface.pixels.astype(int).T
    says = (photo.color[row, column] > 0).any(axis=1) & ~photo.clipped[row, column].all(axis=1)
    return float(says.mean()) if len(says) else 0.0


def doubt(statistic: float, limit: float, psnr: float | None, share: float) -> str:
    """Why the photo is not believed about the shape, as a clause; empty when it is."""
    if statistic > limit:
        return (
            "the photo pulls the shape further than landmarks and face statistics allow (a squared "
            f"distance of {statistic:.0f}, at most {limit:.0f} is plausible)"
        )
    if share < INFORMATIVE_SHARE_MIN:
        return f"only {share:.0%} of the face's pixels are neither black nor saturated"
    if psnr is not None and np.isfinite(psnr) and psnr < EXPLAINED_MIN_DB:
        return f"no face under these lights looks like the photo (PSNR {psnr:.1f} dB)"
    return ""
