"""What ties a user's mesh to its face model: kept on the object as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from typing import Any

import bpy
import numpy as np
from marshmallow import ValidationError

from facestage.contract.schemas.array_field import Array
from facestage.contract.schemas.fields import Checked, Number, Table, Text
from facestage.contract.schemas.schema import FileSchema, checked, decoded_meta

FACTOR_MAX = 1e9  # of numbers in a record


class _Slider(Checked):
    """A shape key, and its value where the shape that it is counts 1."""

    def __init__(self) -> None:
        super().__init__("a shape key and a number that is not 0")

    def _deserialize(
        self, value: Any, attr: str | None, data: Any, **kwargs: Any
    ) -> tuple[str, float]:
        if not isinstance(value, list) or len(value) != 2 or not isinstance(value[0], str):
            raise self.wrong(value)
        factor = Number(-FACTOR_MAX, FACTOR_MAX).deserialize(value[1])
        if factor is None or abs(factor) < 1 / FACTOR_MAX:
            raise self.wrong(value)
        return value[0], float(factor)


def _regular(matrix: np.ndarray) -> None:
    if abs(np.linalg.det(matrix[:3, :3])) < 1e-30 or not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise ValidationError("is no transform of a mesh")


class OwnMeshSchema(FileSchema):
    """The record as the .blend keeps it."""

    identity = Table(_Slider())
    expression = Table(_Slider())
    to_model = Array((4, 4), minimum=-FACTOR_MAX, maximum=FACTOR_MAX, validate=_regular)
    borrowed = Table(Number(-FACTOR_MAX, FACTOR_MAX), load_default=dict)
    uv_layer = Text(load_default="")


@dataclass
class OwnMesh:
    """What ties a user's mesh to its face model."""

    # identity shape -> shape key, and its value at one standard deviation
    identity: dict[str, tuple[str, float]]
    expression: dict[str, tuple[str, float]]  # expression -> shape key, and its value at weight 1
    # (4, 4) the mesh's coordinates -> the model frame
    to_model: list[list[float]] = field(default_factory=list)
    # identity mode of the default model -> fitted weight
    borrowed: dict[str, float] = field(default_factory=dict)
    uv_layer: str = ""

    @classmethod
    def of(cls, rig: bpy.types.Object) -> OwnMesh | None:
        """The object's record, or None for a rig that Facestage built."""
        text = rig.facestage_face.own_mesh
        if not text:
            return None
        subject, again = f"What '{rig.name}' keeps of its face model", "press Use My Mesh again"
        found = checked(OwnMeshSchema(), decoded_meta(text, subject, again), subject, again)
        return cls(**found | {"to_model": found["to_model"].tolist()})

    def store(self, rig: bpy.types.Object) -> None:
        """Keep the record on the object."""
        rig.facestage_face.own_mesh = json.dumps(asdict(self))

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4) float64, from the mesh's own coordinates to the model frame."""
        return np.array(self.to_model, np.float64)
