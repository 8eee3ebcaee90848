"""A picture of all directions as lights: the surroundings of a photo, where they are known.

The picture is a latitude-longitude map of linear radiance, as Blender and others have it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.errors import InputError
from facestage.contract.light_stage import (
    DEFAULT_RADIUS,
    DEFAULT_SIDE,
    FROZEN,
    LightStage,
    fibonacci_stage,
    horizontal_axis,
    joined,
)

ENVIRONMENT_COUNT = 60  # lights for a map


def split_turn(said: str) -> tuple[str, float]:
    """NAME, and the degrees that NAME@DEGREES turns it by about the vertical; 0 without.

    Raises InputError.
    """
    name, mark, text = said.rpartition("@")
    name, text = (name, text) if mark else (said, "0")
    try:
        degrees = float(text)
    except ValueError:
        degrees = math.nan
    if not math.isfinite(degrees):
        raise InputError(
            f"The surroundings '{said}' are turned by '{text}', expected degrees, as in sky.exr@40."
        )
    return name, degrees


def directions(
    height: int, width: int, degrees: float = 0.0
) -> Float[np.ndarray, "height width 3"]:
    """Where the texels of a map lie, in the stage frame, when it is turned by ``degrees`` about the
    vertical.
    """
    elevation = np.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
    azimuth = 2 * np.pi * (0.5 - (np.arange(width) + 0.5) / width)[None, :] - np.radians(degrees)
    # Blender's axes: +X in the middle of the map, +Z up; its -Y is the stage's +Z.
    level = np.cos(elevation)
    parts = level * np.cos(azimuth), np.sin(elevation), -level * np.sin(azimuth)
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def texel_angles(height: int, width: int) -> Float[np.ndarray, " texels"]:
    """The solid angle of each texel of a map, row by row; their sum is 4 pi."""
    edges = np.sin(np.pi * (0.5 - np.arange(height + 1) / height))
    return np.repeat((edges[:-1] - edges[1:]) * 2 * np.pi / width, width)


def lights_all_around(count: int, radius: float, side: float | np.ndarray) -> LightStage:
    """``count`` (an odd one less) dark lights on the spherical Fibonacci lattice of the whole
    sphere, stage frame.
    """
    half = max(count // 2, 1)
    lattice = joined(
        fibonacci_stage(half, radius, radiance=0.0),
        fibonacci_stage(half, radius, radiance=0.0, behind=True),
    )
    return replace(lattice, side=np.broadcast_to(side, len(lattice)).astype(float))


def environment_stage(
    picture: Float[np.ndarray, "height width 3"],
    degrees: float = 0.0,
    count: int = ENVIRONMENT_COUNT,
    radius: float = DEFAULT_RADIUS,
) -> LightStage:
    """``count`` lights all around (stage frame) that give the face the light of a map.

    Each stands for the part of the sphere that is nearest to its place on the lattice, where the
    middle of that part's light is, and sends to the stage's centre as much as the part does. The
    lights are squares as large as a stage's, and held.
    """
    side = DEFAULT_SIDE * radius
    lattice = lights_all_around(count, radius, side)
    height, width = picture.shape[:2]
    towards = directions(height, width, degrees).reshape(-1, 3)
    nearest = np.argmax(towards @ -lattice.direction.T, axis=1)
    angle = texel_angles(height, width)
    flux = angle[:, None] * np.maximum(picture.reshape(-1, 3), 0.0)
    lights = len(lattice)
    total = np.stack([np.bincount(nearest, flux[:, c], lights) for c in range(3)], axis=1)
    level = flux.mean(axis=1)
    middle = np.stack(
        [np.bincount(nearest, level * towards[:, axis], lights) for axis in range(3)], axis=1
    )
    length = np.linalg.norm(middle, axis=1, keepdims=True)
    outward = np.where(length > 0, middle / np.maximum(length, 1e-30), -lattice.direction)
    quarter = (0.5 * side) ** 2
    seen = 4 * np.arcsin(quarter / (quarter + radius**2))  # solid angle of a light
    return replace(
        lattice,
        position=radius * outward,
        direction=-outward,
        axis_x=horizontal_axis(outward),
        radiance=total / seen,
        state=np.full(lights, FROZEN),
    )
