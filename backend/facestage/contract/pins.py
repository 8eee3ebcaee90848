"""Pins: points of the face's surface that an artist has put on their pixels."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from facestage.contract.arrays import Float, Integer
from facestage.contract.errors import InputError
from facestage.contract.landmarks import PIXEL_MAX
from facestage.contract.schemas.array_field import WHOLE, Array
from facestage.contract.schemas.schema import HandWritten, checked

PINS_MAX = 10_000
VERTEX_MAX = 5_000_000
# Standard deviation of a pin as a share of the face's size: a tenth of a sharp landmark's.
PIN_SIGMA_SHARE = 0.00085
DEVIATION_MIN, DEVIATION_MAX = 1e-4, 1e6  # pixels


class PinSchema(HandWritten):
    """The pins of a job.json."""

    dimensions: ClassVar = {"pins": (0, PINS_MAX)}

    corners = Array(("pins", 3), WHOLE, minimum=0, maximum=VERTEX_MAX)
    weights = Array(("pins", 3), minimum=0, maximum=1)
    points = Array(
        ("pins", 2), minimum=-PIXEL_MAX, maximum=PIXEL_MAX, words="[x, y] in pixels for each pin"
    )
    deviation = Array(("pins",), minimum=DEVIATION_MIN, maximum=DEVIATION_MAX)


@dataclass(frozen=True)
class Pins:
    """Where the photo shows points of a face model's surface.

    A point is three ``corners``, vertices of the model, with barycentric ``weights``; ``points``
    are in pixels of the photo, ``deviation`` their standard deviations in pixels.
    """

    corners: Integer[np.ndarray, "pins 3"]
    weights: Float[np.ndarray, "pins 3"]
    points: Float[np.ndarray, "pins 2"]
    deviation: Float[np.ndarray, " pins"]

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def from_json(cls, data: Mapping[str, Any], what: str = "pins") -> Pins:
        """The pins of a decoded job.json. Raises InputError naming what is wrong."""
        found = checked(PinSchema(), data, f"The {what}")
        sums = found["weights"].sum(axis=1)
        if not np.allclose(sums, 1, atol=1e-3):
            raise InputError(
                f"The {what}: the weights of a pin add up to "
                f"{sums[np.abs(sums - 1).argmax()]:.3g}, expected 1."
            )
        return cls(
            found["corners"].reshape(-1, 3),
            found["weights"].astype(np.float64).reshape(-1, 3),
            found["points"].astype(np.float64).reshape(-1, 2),
            found["deviation"].astype(np.float64),
        )

    def to_json(self) -> dict[str, Any]:
        """The pins as job.json holds them."""
        return {name: value.tolist() for name, value in vars(self).items()}
