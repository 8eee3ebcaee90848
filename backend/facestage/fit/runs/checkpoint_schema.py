"""What the arrays of a checkpoint may be, and how it keeps a state."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.schemas.array_field import FLAGS, Array, Words, rigid
from facestage.contract.schemas.fields import Part
from facestage.contract.schemas.schema import FileSchema
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import LATER_FIELDS, STATE_FIELDS


class StateArrays(FileSchema):
    """The arrays of one state; its camera and its numbers are in the meta data."""

    class Meta(FileSchema.Meta):
        """Of marshmallow."""

        include: ClassVar = {
            name: values.array(required=name not in LATER_FIELDS)
            for name, values in STATE_FIELDS.items()
            if values is not None and values.shape
        }


NUMBERS = tuple(
    name for name, values in STATE_FIELDS.items() if values is not None and not values.shape
)


def state_to_arrays(state: State) -> dict[str, np.ndarray]:
    """The arrays of a state by name."""
    return {name: getattr(state, name) for name in StateArrays.Meta.include}


def state_to_meta(state: State) -> dict[str, Any]:
    """The rest of a state, as JSON."""
    numbers = {name: getattr(state, name) for name in NUMBERS}
    return {"camera": state.camera.to_json()} | numbers


def state_of(meta: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> State:
    """The state of which this is the meta data and these are the checked arrays.

    Raises KeyError, TypeError or ValueError for what is no meta data of a state.
    """
    present = [name for name in NUMBERS if name in meta or name not in LATER_FIELDS]
    fields: dict[str, Any] = {name: finite(meta[name]) for name in present} | dict(arrays)
    return State(camera=Camera.from_json(meta["camera"]), **fields)


class CheckpointArrays(FileSchema):
    """All arrays of one photo's checkpoint; the states by what they are of."""

    meta = Words()
    strong = Array(("lights",), FLAGS)
    began = Part(StateArrays)
    start = Part(StateArrays, required=False)
    within = Part(StateArrays, required=False)
    camera_to_stage = Array((4, 4), validate=rigid, required=False)
    hidden = Array(("rows", "columns"), FLAGS, required=False)
    dark = Array(("rows", "columns"), FLAGS, required=False)
    resting = Array(("resting",), FLAGS, required=False)


def finite(value: float) -> float:
    """A number out of a checkpoint's meta data.

    Raises ValueError for NaN and infinity, TypeError for no number.
    """
    number = float(value)
    if not math.isfinite(number):
        raise ValueError(f"{number} is no number")
    return number
