"""The pins of a photo as the .blend keeps them: JSON in one property, saved, undone and changed
with the photo like all else that is known of it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from facestage.contract.camera import FOCAL_MAX, FOCAL_MIN
from facestage.contract.errors import InputError
from facestage.contract.pins import DEVIATION_MIN, Pins
from facestage.contract.schemas.array_field import Array
from facestage.contract.schemas.fields import Number, Part, Plain, Table, Text
from facestage.contract.schemas.schema import FileSchema, checked, decoded_meta

from ..properties import OfPhoto
from .solver import Guess

REMEDY = "press Clear Pins"
NUMBER_MAX = 1e9


class _GuessSchema(FileSchema):
    """A pose and sliders."""

    to_camera = Array((4, 4), minimum=-NUMBER_MAX, maximum=NUMBER_MAX)
    sliders = Array(("sliders",), minimum=-NUMBER_MAX, maximum=NUMBER_MAX)
    focal_px = Number(FOCAL_MIN, FOCAL_MAX, load_default=None)


class _RecordSchema(FileSchema):
    """The property."""

    model = Text()
    pins = Table(Plain())
    before = Part(_GuessSchema, "a pose and sliders", load_default=None)
    after = Part(_GuessSchema, "a pose and sliders", load_default=None)


def no_pins() -> Pins:
    """None yet."""
    return Pins(np.zeros((0, 3), np.int64), np.zeros((0, 3)), np.zeros((0, 2)), np.zeros(0))


@dataclass(frozen=True)
class Record:
    """A photo's pins, the face model that they are of, and the face ``before`` the first and
    ``after`` the last of them: a face that stands elsewhere by now is where the next one begins.
    """

    model: str
    pins: Pins = field(default_factory=no_pins)
    before: Guess | None = None
    after: Guess | None = None

    @classmethod
    def of(cls, settings: OfPhoto, rig: bpy.types.Object) -> Record:
        """What the photo's settings hold for a rig.

        Raises InputError where that is damaged, or was made on another face model.
        """
        model = rig.facestage_face.model
        if not settings.pins:
            return cls(model)
        subject = "What the scene keeps of its pins"
        found = checked(
            _RecordSchema(), decoded_meta(settings.pins, subject, REMEDY), subject, REMEDY
        )
        record = cls(
            found["model"],
            Pins.from_json(found["pins"], "scene's pins"),
            *(found[name] and Guess(**found[name]) for name in ("before", "after")),
        )
        vertices = len(rig.data.vertices)
        if record.model != model or (record.pins.corners >= vertices).any():
            raise InputError(
                f"The pins were set on the face model '{record.model}', the rig is of '{model}'; "
                f"{REMEDY}, and set them anew."
            )
        return record

    def store(self, settings: OfPhoto) -> None:
        """Keep it; no pins leave nothing behind."""
        guesses = {"before": self.before, "after": self.after}
        data = {
            "model": self.model,
            "pins": self.pins.to_json(),
            **{name: each and _as_json(each) for name, each in guesses.items()},
        }
        settings.pins = json.dumps(data) if len(self.pins) else ""


def photo_pins(settings: OfPhoto, rig: bpy.types.Object) -> Pins | None:
    """The pins of a photo for its job; None without any. Raises InputError as :meth:`Record.of`."""
    pins = Record.of(settings, rig).pins
    return pins if len(pins) else None


def pin_count(settings: OfPhoto) -> int:
    """How many pins a photo has; 0 where they cannot be read."""
    try:
        data = json.loads(settings.pins or "{}")
        return len(data["pins"]["points"])
    except (ValueError, KeyError, TypeError):
        return 0


def with_pin(
    pins: Pins, corners: np.ndarray, weights: np.ndarray, pixel: np.ndarray, deviation: float
) -> Pins:
    """One more, at the end; all with this ``deviation`` in pixels."""
    return Pins(
        np.concatenate([pins.corners, corners[None].astype(np.int64)]),
        np.concatenate([pins.weights, weights[None]]),
        np.concatenate([pins.points, pixel[None]]),
        np.full(len(pins) + 1, max(deviation, DEVIATION_MIN)),
    )


def without_pin(pins: Pins, index: int) -> Pins:
    """All but one."""
    return Pins(**{name: np.delete(value, index, axis=0) for name, value in vars(pins).items()})


def moved_pin(pins: Pins, index: int, pixel: np.ndarray) -> Pins:
    """One of them put on another pixel."""
    points = pins.points.copy()
    points[index] = pixel
    return replace(pins, points=points)


def _as_json(guess: Guess) -> dict[str, object]:
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else value
        for name, value in vars(guess).items()
        if value is not None
    }
