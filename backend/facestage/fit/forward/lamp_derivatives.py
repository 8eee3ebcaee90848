"""How the light on the face changes as strong lights turn about the stage's centre."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from facestage.contract.light_stage import LightStage

if TYPE_CHECKING:
    from facestage.fit.face.state import State
    from facestage.fit.forward.shading import ForwardModel, Surface
from facestage.fit.face.lamps import turned

AXES = 2  # sideways and up, radians


# Half the turn of a finite difference, radians: moves a shadow by less than a light's own width.
HALF_STEP = 0.02


@dataclass(frozen=True)
class PositionDerivatives:
    """How the strong lights' terms change as they turn: unit radiance, shadows included."""

    lights: np.ndarray  # (K,) numbers of the lights
    diffuse: np.ndarray  # (P, K, 2)
    specular: np.ndarray  # (P, K, 2)


def position_derivatives(
    forward: ForwardModel,
    state: State,
    surface: Surface,
    stage: LightStage,
    pivot: np.ndarray,
    strong: np.ndarray,
    samples: int,
    seed: int,
) -> PositionDerivatives:
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
