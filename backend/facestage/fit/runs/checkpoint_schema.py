"""What the arrays of a checkpoint may be."""

from __future__ import annotations

import math

from facestage.contract.light_stage import FAR
from facestage.contract.schemas.array_field import FLAGS, Array, Words, rigid
from facestage.contract.schemas.fields import Part
from facestage.contract.schemas.schema import FileSchema


class StateArrays(FileSchema):
    """The arrays of one state."""

    rotation = Array((3, 3), minimum=-2, maximum=2)
    translation = Array((3,), minimum=-FAR, maximum=FAR)
    identity = Array(("identity",))
    expression = Array(("expression",))
    lights = Array(("parameters",))
    light_position = Array(("lights", 2))
    albedo = Array(("albedo",))
    specular = Array(("texels", "texels"))


class CheckpointArrays(FileSchema):
    """All arrays of one photo's checkpoint; the states by what they are of."""

    meta = Words()
    strong = Array(("lights",), FLAGS)
    began = Part(StateArrays)
    start = Part(StateArrays, required=False)
    within = Part(StateArrays, required=False)
    camera_to_stage = Array((4, 4), validate=rigid, required=False)
    hidden = Array(("rows", "columns"), FLAGS, required=False)
    resting = Array(("resting",), FLAGS, required=False)


def finite(value: float) -> float:
    """A number out of a checkpoint's meta data.

    Raises ValueError for NaN and infinity, TypeError for no number.
    """
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{number} is no number")
    return number
