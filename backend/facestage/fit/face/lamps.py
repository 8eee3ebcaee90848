"""Where strong lights really stand: each may turn about the stage's centre, away from its place on
the lattice.

A lamp between two lights of the lattice would become two weaker ones, its highlights and shadows
two; the geometry would bend to make up for them.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.arrays import Bool, Float
from facestage.contract.light_stage import LightStage

# A light with less than this share of the flux casts no highlight or shadow worth following.
STRONG_SHARE, STRONG_MAX = 0.12, 4
RIM_SHARE = 0.02  # of all flux, from which on a light behind the face counts


def spacing(count: int) -> float:
    """Radians between neighbours among ``count`` lights on a hemisphere, at most a right angle."""
    return float(min(np.sqrt(2.0 * np.pi / max(count, 1)), np.pi / 2))


def turned(
    stage: LightStage, angles: Float[np.ndarray, "lights 2"], pivot: Float[np.ndarray, " 3"]
) -> LightStage:
    """``stage`` with light j turned by ``angles`` about ``pivot``, same frame:
    sideways, then up.
    """
    if not angles.any():
        return stage
    rotation = Rotation.from_rotvec(angles[:, :1] * stage.axis_y + angles[:, 1:] * stage.axis_x)
    return replace(
        stage,
        position=rotation.apply(stage.position - pivot) + pivot,
        direction=rotation.apply(stage.direction),
        axis_x=rotation.apply(stage.axis_x),
    )


def strong_lights(
    stage: LightStage, radiance: Float[np.ndarray, "lights 3"], fitted: Bool[np.ndarray, " lights"]
) -> Bool[np.ndarray, " lights"]:
    """The fitted lights of a ``stage`` (stage frame) whose place matters, by their share of the
    flux of ``radiance``; behind the face, where a light's place says how wide its rim is, of the
    flux from there.
    """
    flux = radiance.mean(axis=1) * stage.side**2
    share = np.where(fitted, flux, 0.0) / max(float(flux.sum()), 1e-30)
    behind = stage.position[:, 2] < 0
    rims = np.where(behind & (share >= RIM_SHARE), share, 0.0)
    rims /= max(float(share[behind].sum()), 1e-30)
    return _strongest(share, ~behind & fitted) | _strongest(rims, behind & fitted)


def _strongest(
    share: Float[np.ndarray, " lights"], among: Bool[np.ndarray, " lights"]
) -> Bool[np.ndarray, " lights"]:
    share = np.where(among, share, 0.0)
    weakest = np.sort(share)[::-1][min(STRONG_MAX, len(share)) - 1]
    return (share >= max(STRONG_SHARE, weakest)) & among
