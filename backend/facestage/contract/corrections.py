"""Corrections: what an artist has changed of a sequence by hand, weights and poses of frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from marshmallow import ValidationError, validates_schema

from facestage.contract.arrays import Float
from facestage.contract.files.storage import read_json, write_json
from facestage.contract.light_stage import FAR
from facestage.contract.parameters import WEIGHT_MAX
from facestage.contract.schemas.array_field import Array, rigid
from facestage.contract.schemas.fields import Items, Number, Part, Table, Whole
from facestage.contract.schemas.schema import HandWritten, check_version, checked

SCHEMA_VERSION = 1
CORRECTIONS_MAX = 200_000
NUMBER_MAX = 10**9


@dataclass(frozen=True, eq=False)
class Correction:
    """What is known of one frame: the weights that were set, by name, and the pose if it was."""

    frame: int  # its number
    weights: dict[str, float] = field(default_factory=dict)
    model_to_camera: Float[np.ndarray, "4 4"] | None = None  # metres

    def to_json(self) -> dict[str, Any]:
        """As a file holds it."""
        data: dict[str, Any] = {"frame": self.frame, "weights": self.weights}
        if self.model_to_camera is not None:
            data["model_to_camera"] = self.model_to_camera.tolist()
        return data

    def after(self, earlier: Correction | None) -> Correction:
        """With what an ``earlier`` one says of the same frame, where this one says nothing."""
        if earlier is None:
            return self
        pose = earlier.model_to_camera if self.model_to_camera is None else self.model_to_camera
        return Correction(self.frame, earlier.weights | self.weights, pose)


class CorrectionSchema(HandWritten):
    """A frame of a file of corrections."""

    frame = Whole(0, NUMBER_MAX)
    weights = Table(Number(-WEIGHT_MAX, WEIGHT_MAX), load_default=dict)
    model_to_camera = Array((4, 4), minimum=-FAR, maximum=FAR, load_default=None, allow_none=True)

    @validates_schema
    def _rigid(self, data: dict[str, Any], **_: Any) -> None:
        if data.get("model_to_camera") is not None:
            try:
                rigid(data["model_to_camera"])
            except ValidationError as error:
                raise ValidationError({"model_to_camera": error.messages}) from error


class CorrectionsSchema(HandWritten):
    """A file of corrections."""

    schema = Whole(SCHEMA_VERSION, SCHEMA_VERSION)
    frames = Items(Part(CorrectionSchema, "a frame"), 1, CORRECTIONS_MAX)


def write_corrections(path: Path, corrections: Sequence[Correction]) -> None:
    """Write them as JSON."""
    frames = [each.to_json() for each in corrections]
    write_json(path, {"schema": SCHEMA_VERSION, "frames": frames})


def read_corrections(path: Path) -> tuple[Correction, ...]:
    """Those of a file, one a frame, in order. Raises InputError naming what is wrong."""
    data, subject = read_json(path, "file of corrections"), f"The file of corrections '{path}'"
    remedy = "write it as docs/sequences.md says"
    check_version(data, SCHEMA_VERSION, subject, remedy)
    found = checked(CorrectionsSchema(), data, subject, remedy)
    return joined((), [Correction(**each) for each in found["frames"]])


def joined(earlier: Sequence[Correction], later: Sequence[Correction]) -> tuple[Correction, ...]:
    """Both, one a frame, in order; where both say something, the ``later`` one holds."""
    frames: dict[int, Correction] = {}
    for each in (*earlier, *later):
        frames[each.frame] = each.after(frames.get(each.frame))
    return tuple(frames[number] for number in sorted(frames))
