"""Lamps anywhere around the head, not only where the fit's own stage has lights. No bpy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from facestage.contract.light_stage import ON, LightStage

# How far a recipe's lamps may be from where they are drawn, so that no two seeds have the same
# light. degrees, shares, degrees
ANGLE_SPREAD, DISTANCE_SPREAD, POWER_SPREAD, AIM_SPREAD = 6.0, 0.08, 0.2, 4.0


@dataclass(frozen=True)
class Lamp:
    """A square lamp seen from the face: azimuth towards the picture's right, elevation upwards, in
    degrees.

    ``irradiance`` is what it gives a surface at the face's centre that faces it, whatever its size
    and distance (m). Azimuths beyond 90 degrees lie behind the head.
    """

    azimuth: float
    elevation: float
    irradiance: float = 1.0
    distance: float = 1.0
    side: float = 0.2
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)


def light_stage(lamps: Sequence[Lamp], rng: np.random.Generator) -> LightStage:
    """The lamps, each moved a little, aimed a little off the face and turned about its axis, in the
    stage frame.
    """
    count = len(lamps)
    azimuth, elevation = np.radians(
        np.array([(lamp.azimuth, lamp.elevation) for lamp in lamps])
        + ANGLE_SPREAD * rng.uniform(-1, 1, (count, 2))
    ).T
    distance = np.array([lamp.distance for lamp in lamps]) * (
        1 + DISTANCE_SPREAD * rng.uniform(-1, 1, count)
    )
    irradiance = np.array([lamp.irradiance for lamp in lamps]) * (
        1 + POWER_SPREAD * rng.uniform(-1, 1, count)
    )
    outward = np.stack(
        [
            np.sin(azimuth) * np.cos(elevation),
            np.sin(elevation),
            np.cos(azimuth) * np.cos(elevation),
        ],
        axis=1,
    )
    direction = -outward + np.tan(np.radians(AIM_SPREAD)) * rng.uniform(-1, 1, (count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    axis_x = np.cross(direction, rng.normal(size=(count, 3)))
    axis_x /= np.linalg.norm(axis_x, axis=1, keepdims=True)
    side = np.array([lamp.side for lamp in lamps])
    radiance = (irradiance * distance**2 / side**2)[:, None] * np.array(
        [lamp.color for lamp in lamps]
    )
    return LightStage(
        distance[:, None] * outward, direction, axis_x, side, radiance, np.full(count, ON)
    )
