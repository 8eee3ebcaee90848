"""How the light on the face changes as strong lights turn about the stage's centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float, Int
from facestage.contract.light_stage import LightStage
from facestage.fit.face.lamps import turned
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel, Surface

AXES = 2  # sideways and up, radians


# Half the turn of a finite difference, radians: moves a shadow by less than a light's own width.
HALF_STEP = 0.02


@dataclass(frozen=True)
class PositionDerivatives:
    """How the strong lights' terms change as they turn: unit radiance, shadows included."""

    lights: Int[np.ndarray, " strong"]  # numbers of the lights
    diffuse: Float[np.ndarray, "pixels strong 2"]
    specular: Float[np.ndarray, "pixels strong 2"]


def position_derivatives(
    forward: ForwardModel,
    state: State,
    surface: Surface,
    stage: LightStage,
    pivot: Float[np.ndarray, " 3"],
    strong: Bool[np.ndarray, " lights"],
    samples: int,
    seed: int,
) -> PositionDerivatives:
    """Central differences by ``state.light_position``, the same random numbers on both sides.

    ``stage`` is in the camera frame and not yet turned; ``strong`` selects the lights.
    """
    number = np.flatnonzero(strong)
    diffuse = np.zeros((len(surface.pixels), len(number), AXES), np.float32)
    specular = np.zeros_like(diffuse)
    for axis in range(AXES):
        for sign in (1.0, -1.0):
            angles = state.light_position.copy()
            angles[number, axis] += sign * HALF_STEP
            placed = turned(stage, angles, pivot)
            terms = forward.light_terms(
                state, surface, placed, samples, seed, traced=strong, bounced=False
            )
            diffuse[..., axis] += sign / (2 * HALF_STEP) * terms.diffuse[:, number]
            specular[..., axis] += sign / (2 * HALF_STEP) * terms.specular[:, number]
    return PositionDerivatives(number, diffuse, specular)
