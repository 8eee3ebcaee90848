"""Where strong lights really stand: each may turn about the stage's centre, away from its place on the lattice.

A lamp between two lights of the lattice would become two weaker ones, its highlights and shadows two; the
geometry would bend to make up for them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.contract.light_stage import LightStage

if TYPE_CHECKING:
    from facestage.fit.parameters import State
    from facestage.fit.shading import ForwardModel, Surface

AXES = 2  # sideways and up, radians
# A light with less than this share of the flux casts no highlight or shadow worth following.
STRONG_SHARE, STRONG_MAX = 0.12, 4
# Half the turn of a finite difference, radians: moves a shadow by less than a light's own width.
HALF_STEP = 0.02


@dataclass(frozen=True)
class PositionDerivatives:
    """How the strong lights' terms change as they turn: unit radiance, shadows included."""

    lights: np.ndarray  # (K,) numbers of the lights
    diffuse: np.ndarray  # (P, K, 2)
    specular: np.ndarray  # (P, K, 2)


def spacing(count: int) -> float:
    """Radians between neighbours among ``count`` lights on a hemisphere, at most a right angle."""
    return float(min(np.sqrt(2.0 * np.pi / max(count, 1)), np.pi / 2))


def turned(stage: LightStage, angles: np.ndarray, pivot: np.ndarray) -> LightStage:
    """``stage`` with light j turned by ``angles`` (N, 2) about ``pivot`` (3,), same frame: sideways, then up."""
    if not angles.any():
        return stage
    rotation = Rotation.from_rotvec(angles[:, :1] * stage.axis_y + angles[:, 1:] * stage.axis_x)
    return replace(
        stage,
        position=rotation.apply(stage.position - pivot) + pivot,
        direction=rotation.apply(stage.direction),
        axis_x=rotation.apply(stage.axis_x),
    )


def strong_lights(stage: LightStage, radiance: np.ndarray, fitted: np.ndarray) -> np.ndarray:
    """(N,) bool: the fitted lights whose place matters, by their share of the flux of ``radiance`` (N, 3)."""
    flux = radiance.mean(axis=1) * stage.side**2
    share = np.where(fitted, flux, 0.0) / max(float(flux.sum()), 1e-30)
    weakest = np.sort(share)[::-1][min(STRONG_MAX, len(share)) - 1]
    return (share >= max(STRONG_SHARE, weakest)) & fitted


def position_derivatives(
    forward: ForwardModel, state: State, surface: Surface, stage: LightStage, pivot: np.ndarray, strong: np.ndarray,
    samples: int, seed: int,
) -> PositionDerivatives:  # fmt: skip
    """Central differences by ``state.light_position``, the same random numbers on both sides.

    ``stage`` is in the camera frame and not yet turned; ``strong`` (N,) bool selects the lights.
    """
    number = np.flatnonzero(strong)
    diffuse = np.zeros((len(surface.pixels), len(number), AXES), np.float32)
    specular = np.zeros_like(diffuse)
    for axis in range(AXES):
        for sign in (1.0, -1.0):
            angles = state.light_position.copy()
            angles[number, axis] += sign * HALF_STEP
            placed = turned(stage, angles, pivot)
            terms = forward.light_terms(state, surface, placed, samples, seed, traced=strong)
            diffuse[..., axis] += sign / (2 * HALF_STEP) * terms.diffuse[:, number]
            specular[..., axis] += sign / (2 * HALF_STEP) * terms.specular[:, number]
    return PositionDerivatives(number, diffuse, specular)
