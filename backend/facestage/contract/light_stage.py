"""The virtual light stage: square one-sided area lights on a hemisphere around the face."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from marshmallow import ValidationError, validates_schema

from facestage.contract.arrays import Float, Int, Shaped
from facestage.contract.errors import InputError
from facestage.contract.schemas.array_field import WHOLE, Array, unit
from facestage.contract.schemas.schema import FileSchema

# The arrays of a stage, by the names they have in files.
LIGHT_ARRAYS = ("position", "direction", "axis_x", "side", "radiance", "state")
ON, FROZEN, OFF = 0, 1, 2  # fitted | kept at its radiance | radiance exactly 0
DEFAULT_COUNT = 20
DEFAULT_RADIUS = 1.0  # metres
DEFAULT_SIDE = 0.2  # metres
COUNT_MAX = 10_000
FAR = 1e9  # metres: nothing in a file may lie further off
# in files; their products stay within single floats
SIDE_LEAST, SIDE_MOST, RADIANCE_MAX = 1e-6, 1e6, 1e15
# Lights behind the face: how much denser they stand, because a rim is as wide as its lamp's place
# says, and how far behind, as a share of the distance; from further back a light only draws the
# outline.
BEHIND_FINER, BEHIND_MOST = 3, 0.9
BEHIND_COUNT_MAX = 120  # on the lattice; stages of more lights than 40 need none denser
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


@dataclass(frozen=True)
class LightStage:
    """N square area lights. All arrays share the same frame (named by whoever holds the stage).

    A light spans centre +- side/2 along ``axis_x`` and ``axis_y = direction x axis_x`` and emits
    ``radiance`` on the side its ``direction`` points to.
    """

    position: Float[np.ndarray, "lights 3"]  # m, centres
    direction: Float[np.ndarray, "lights 3"]  # unit, towards the face
    axis_x: Float[np.ndarray, "lights 3"]  # unit, along one side of the square
    side: Float[np.ndarray, " lights"]  # m
    radiance: Float[np.ndarray, "lights 3"]  # linear RGB
    state: Int[np.ndarray, " lights"]  # ON, FROZEN or OFF

    def __post_init__(self) -> None:
        n = len(self.position)
        shapes = {
            "position": (n, 3),
            "direction": (n, 3),
            "axis_x": (n, 3),
            "side": (n,),
            "radiance": (n, 3),
            "state": (n,),
        }
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape:
                raise InputError(
                    f"The light stage's {name} has shape {array.shape}, expected {shape}."
                )
            if not np.issubdtype(array.dtype, np.number):
                raise InputError(
                    f"The light stage's {name} holds {array.dtype} values, expected numbers."
                )
            if not np.isfinite(array).all():
                raise InputError(f"The light stage's {name} holds NaN or infinity.")
        if n < 1:
            raise InputError("The light stage has no light; at least one is needed.")
        if (self.radiance < 0).any():
            raise InputError(
                "A light of the stage has negative radiance; radiance must be 0 or more."
            )
        if (self.side <= 0).any():
            raise InputError("A light of the stage has no size; its side must be greater than 0.")

    def __len__(self) -> int:
        return len(self.position)

    @property
    def axis_y(self) -> Float[np.ndarray, "lights 3"]:
        """Unit vectors along the other side of the square."""
        return np.cross(self.direction, self.axis_x)

    @property
    def corners(self) -> Float[np.ndarray, "lights 4 3"]:
        """The corners of each light in metres, in order around the square."""
        half = 0.5 * self.side[:, None]
        x, y = half * self.axis_x, half * self.axis_y
        return self.position[:, None] + np.stack([-x - y, x - y, x + y, -x + y], axis=1)

    def transformed(self, matrix: Float[np.ndarray, "4 4"]) -> LightStage:
        """The stage in another frame; ``matrix`` is a rigid transform."""
        rotation, translation = np.asarray(matrix)[:3, :3], np.asarray(matrix)[:3, 3]
        return replace(
            self,
            position=self.position @ rotation.T + translation,
            direction=self.direction @ rotation.T,
            axis_x=self.axis_x @ rotation.T,
        )

    def with_radiance(self, radiance: Float[np.ndarray, "lights 3"]) -> LightStage:
        """The same lights at another radiance; off lights stay at exactly 0."""
        radiance = np.where((self.state == OFF)[:, None], 0.0, np.asarray(radiance, np.float64))
        return replace(self, radiance=radiance)


class StageSchema(FileSchema):
    """The arrays of a light stage in a job or a result."""

    dimensions: ClassVar = {"lights": (1, COUNT_MAX)}

    position = Array(("lights", 3), minimum=-FAR, maximum=FAR)
    direction = Array(("lights", 3), minimum=-2, maximum=2, validate=unit)
    axis_x = Array(("lights", 3), minimum=-2, maximum=2, validate=unit)
    side = Array(("lights",), minimum=SIDE_LEAST, maximum=SIDE_MOST)
    radiance = Array(("lights", 3), minimum=0, maximum=RADIANCE_MAX)
    state = Array(("lights",), WHOLE, minimum=ON, maximum=OFF)

    @validates_schema
    def _square(self, data: dict[str, Any], **_: Any) -> None:
        if np.abs((data["direction"] * data["axis_x"]).sum(axis=1)).max() > 1e-3:
            raise ValidationError(
                {"axis_x": ["holds axes that are not at right angles to the lights' directions"]}
            )


def fibonacci_stage(
    count: int = DEFAULT_COUNT,
    radius: float = DEFAULT_RADIUS,
    side: float = DEFAULT_SIDE,
    radiance: float = 1.0,
    *,
    behind: bool = False,
) -> LightStage:
    """``count`` lights on the spherical Fibonacci lattice of the hemisphere whose pole is +Z.

    Heights are evenly spaced, so that each light covers the same solid angle (Swinbank & Purser
    2006); each light faces the origin. The frame is the stage frame: +Z points from the face to the
    camera. ``behind``: the other ``count`` lights of the same lattice, which goes on over the whole
    sphere.
    """
    if not 1 <= count <= COUNT_MAX:
        raise InputError(
            f"The light stage was asked for {count} lights; expected 1 to {COUNT_MAX}."
        )
    if not (radius > 0 and side > 0):
        raise InputError(
            f"The light stage's radius {radius} and light side {side} must be greater than 0 "
            "metres."
        )
    index = np.arange(count) + (count if behind else 0)
    height = 1.0 - (index + 0.5) / count
    ring = np.sqrt(1.0 - height**2)
    angle = GOLDEN_ANGLE * index
    outward = np.stack([ring * np.cos(angle), ring * np.sin(angle), height], axis=1)
    return LightStage(
        position=radius * outward,
        direction=-outward,
        axis_x=horizontal_axis(outward),
        side=np.full(count, float(side)),
        radiance=np.full((count, 3), float(radiance)),
        state=np.full(count, ON),
    )


def selected(stage: LightStage, keep: Shaped[np.ndarray, " _"]) -> LightStage:
    """Some of the lights (a mask or numbers)."""
    return LightStage(**{name: getattr(stage, name)[keep] for name in LIGHT_ARRAYS})


def joined(stage: LightStage, other: LightStage) -> LightStage:
    """The lights of both, in one frame."""
    return LightStage(
        **{
            name: np.concatenate([getattr(stage, name), getattr(other, name)])
            for name in LIGHT_ARRAYS
        }
    )


def lights_behind(stage: LightStage) -> LightStage | None:
    """Dark lights behind the face for a ``stage`` (stage frame) in front of it, as far away and as
    large: the other half of a denser lattice, but for those that the head hides. None where the
    stage has lights behind the face already.
    """
    if (stage.position[:, 2] < 0).any():
        return None
    radius = float(np.median(np.linalg.norm(stage.position, axis=1)))
    side = float(np.median(stage.side))
    count = min(BEHIND_FINER * len(stage), BEHIND_COUNT_MAX)
    behind = fibonacci_stage(count, radius, side, radiance=0.0, behind=True)
    return selected(behind, np.flatnonzero(behind.direction[:, 2] < BEHIND_MOST))


def horizontal_axis(outward: Float[np.ndarray, "lights 3"]) -> Float[np.ndarray, "lights 3"]:
    """A unit tangent of each direction, level where the direction is not vertical."""
    up = np.where(np.abs(outward[:, 1:2]) < 0.999, [[0.0, 1.0, 0.0]], [[0.0, 0.0, 1.0]])
    axis = np.cross(up, outward)
    return axis / np.linalg.norm(axis, axis=1, keepdims=True)
