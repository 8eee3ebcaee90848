"""A reflectance field: a fitted face under distant light from each of many directions.

reflectance.json says what the pictures beside it are; any other distant light is a sum of them
(Debevec et al. 2000).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from marshmallow import ValidationError, validates_schema

from facestage.contract.arrays import Float
from facestage.contract.camera import Camera, CameraSchema
from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file, is_folder
from facestage.contract.files.storage import read_json, write_json
from facestage.contract.light_stage import FAR
from facestage.contract.schemas.array_field import Array, rigid, unit
from facestage.contract.schemas.fields import Items, Name, Part, Whole
from facestage.contract.schemas.schema import FileSchema, check_version, checked

SCHEMA_VERSION = 1
FILE = "reflectance.json"
DIRECTIONS_LEAST, DIRECTIONS_MOST = 12, 2048
FRAME = (
    "stage: right-handed, +Y up, a face at rest looks along +Z; directions point from the face to "
    "the light"
)
SUM_TOLERANCE = 1e-3  # of the solid angles' sum, relative


@dataclass(frozen=True)
class ReflectanceField:
    """What the pictures of a folder are: ``images[i]`` (linear RGB, the camera's size) shows the
    face under radiance 1 from all around ``directions[i]``, over ``solid_angles[i]``.
    """

    model: str
    camera: Camera
    camera_to_stage: Float[np.ndarray, "4 4"]
    directions: Float[np.ndarray, "lights 3"]  # unit, stage frame, from the face to the light
    solid_angles: Float[np.ndarray, " lights"]  # sr; their sum is 4 pi
    images: tuple[str, ...]  # names of files in the folder
    samples: int  # shadow rays per light and sub-pixel
    folder: Path | None = None

    def write_into(self, folder: Path) -> None:
        """Write reflectance.json into an existing folder."""
        data = {
            "schema": SCHEMA_VERSION,
            "frame": FRAME,
            "model": self.model,
            "camera": self.camera.to_json(),
            "camera_to_stage": self.camera_to_stage,
            "directions": self.directions,
            "solid_angles": self.solid_angles,
            "images": list(self.images),
            "samples": self.samples,
        }
        write_json(folder / FILE, data)

    @classmethod
    def load(cls, folder: Path) -> ReflectanceField:
        """Read reflectance.json. Raises InputError for what is missing or not possible."""
        folder = Path(folder)
        if not is_folder(folder):
            raise InputError(f"The reflectance field '{folder}' does not exist.")
        data = read_json(folder / FILE, "reflectance field")
        subject, again = f"The reflectance field '{folder}'", "make it again"
        check_version(data, SCHEMA_VERSION, subject, again)
        found: dict[str, Any] = checked(FieldSchema(), data, f"{subject} is damaged; it", again)
        del found["schema"]
        return cls(camera=Camera(**found.pop("camera")), folder=folder, **found)


def is_field(folder: Path) -> bool:
    """Whether a folder is a reflectance field."""
    return is_file(Path(folder) / FILE)


class FieldSchema(FileSchema):
    """A reflectance.json."""

    dimensions: ClassVar = {"lights": (DIRECTIONS_LEAST, DIRECTIONS_MOST)}

    schema = Whole(SCHEMA_VERSION, SCHEMA_VERSION)
    model = Name()
    camera = Part(CameraSchema, "a camera")
    camera_to_stage = Array((4, 4), minimum=-FAR, maximum=FAR, validate=rigid)
    directions = Array(("lights", 3), minimum=-2, maximum=2, validate=unit)
    solid_angles = Array(("lights",), minimum=0, maximum=4 * np.pi)
    images = Items(Name(), DIRECTIONS_LEAST, DIRECTIONS_MOST, unique=True)
    samples = Whole(1, 10**6)

    @validates_schema
    def _agree(self, data: dict[str, Any], **_: Any) -> None:
        count, total = len(data["directions"]), float(data["solid_angles"].sum())
        if len(data["images"]) != count:
            words = f"has {len(data['images'])} entries, expected {count}, one for each direction"
            raise ValidationError({"images": [words]})
        for name in data["images"]:
            if Path(name).name != name:
                raise ValidationError({"images": ["names a file that is not in the folder"]})
        if abs(total / (4 * np.pi) - 1) > SUM_TOLERANCE:
            words = f"sum up to {total:.4f}, expected 4 pi"
            raise ValidationError({"solid_angles": [words]})
