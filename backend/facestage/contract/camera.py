"""The pinhole camera of a photograph."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.arrays import Float, Float64
from facestage.contract.errors import InputError
from facestage.contract.files.storage import read_json
from facestage.contract.schemas.fields import Items, Number, Whole
from facestage.contract.schemas.schema import FileSchema, checked

# A 50 mm lens on a 36 mm wide sensor, the usual guess for a portrait whose lens is unknown.
DEFAULT_FOCAL_PER_SIDE = 50.0 / 36.0
# A picture of so many pixels takes 1.6 GB as linear RGB, and a few times that while it is made.
SIDE_MAX, PIXELS_MAX = 16384, 2**27
FOCAL_MIN, FOCAL_MAX = 1e-3, 1e7  # pixels, in files
PRINCIPAL_MAX = 1e7


class CameraSchema(FileSchema):
    """A camera.json, and the camera in a job or a result."""

    width = Whole(1, SIDE_MAX)
    height = Whole(1, SIDE_MAX)
    focal_px = Number(FOCAL_MIN, FOCAL_MAX)
    principal_px = Items(Number(-PRINCIPAL_MAX, PRINCIPAL_MAX), 2, 2)


@dataclass(frozen=True)
class Camera:
    """Pinhole camera with square pixels: sizes, focal length and principal point in pixels."""

    width: int
    height: int
    focal_px: float
    principal_px: tuple[float, float]

    def __post_init__(self) -> None:
        if not (1 <= self.width <= SIDE_MAX and 1 <= self.height <= SIDE_MAX):
            raise InputError(
                f"The camera's size is {self.width} x {self.height} pixels; expected 1 to "
                f"{SIDE_MAX} each."
            )
        if self.width * self.height > PIXELS_MAX:
            raise InputError(
                f"The camera's size is {self.width} x {self.height} = "
                f"{self.width * self.height / 1e6:.0f} million "
                f"pixels; expected at most {PIXELS_MAX / 1e6:.0f} million."
            )
        if not (math.isfinite(self.focal_px) and self.focal_px > 0):
            raise InputError(
                f"The camera's focal_px is {self.focal_px}; expected a positive number of pixels."
            )
        if len(self.principal_px) != 2 or not all(
            math.isfinite(value) for value in self.principal_px
        ):
            raise InputError(
                f"The camera's principal_px is {self.principal_px}; expected two finite numbers."
            )

    @classmethod
    def default(cls, width: int, height: int, focal_px: float | None = None) -> Camera:
        """A centred camera; without ``focal_px`` a 50 mm full-frame lens along the longer side."""
        focal = DEFAULT_FOCAL_PER_SIDE * max(width, height) if focal_px is None else focal_px
        return cls(width, height, float(focal), (width / 2.0, height / 2.0))

    @classmethod
    def from_json(cls, data: Mapping[str, Any], what: str = "camera") -> Camera:
        """The camera of a decoded camera.json. Raises InputError naming what is missing."""
        return cls(**checked(CameraSchema(), data, f"The {what}"))

    @classmethod
    def read(cls, path: Path) -> Camera:
        """The camera in a camera.json file."""
        return cls.from_json(read_json(path, "camera file"), f"camera file '{path}'")

    def to_json(self) -> dict[str, Any]:
        """The camera as camera.json holds it."""
        return asdict(self)

    def scaled(self, factor: float) -> Camera:
        """The same camera for an image resized by ``factor``."""
        return Camera(
            max(1, round(self.width * factor)),
            max(1, round(self.height * factor)),
            self.focal_px * factor,
            (self.principal_px[0] * factor, self.principal_px[1] * factor),
        )

    def project(self, points: Float[np.ndarray, "points 3"]) -> Float64[np.ndarray, "points 2"]:
        """Pixels of camera-frame points in metres; behind the camera gives NaN."""
        points = np.asarray(points, np.float64)
        depth = np.where(points[:, 2] < 0, -points[:, 2], np.nan)
        x = self.focal_px * points[:, 0] / depth + self.principal_px[0]
        y = -self.focal_px * points[:, 1] / depth + self.principal_px[1]
        return np.stack([x, y], axis=1)
