"""What a fit of several photos of one person says beside each photo's own result: person.json."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.files.storage import read_json, write_json
from facestage.contract.parameters import SIZES, as_fields, shared_values
from facestage.contract.result import STATUSES
from facestage.contract.schemas.fields import (
    Choice,
    Figures,
    Flag,
    Items,
    Name,
    Part,
    PathText,
    Text,
    Whole,
)
from facestage.contract.schemas.schema import FileSchema, check_version, checked

SCHEMA_VERSION = 1
FILE = "person.json"
PHOTOS_MAX = 8


@dataclass(frozen=True)
class PersonPhoto:
    """One of the photos."""

    number: int  # 1, 2, ...
    image: str  # path of the photo
    folder: str  # its result folder, relative to the person's
    status: str  # the result's
    advice: str
    shares_shape: bool  # whether it took part in the shape and skin that all photos show
    errors: dict[str, float]


@dataclass(frozen=True)
class Person:
    """The shared parameters, and the photos that they were fitted to.

    ``folder`` holds albedo.exr and person.html.
    """

    status: str  # converged, budget_spent or stopped, as in a result
    advice: str
    model: str
    photos: tuple[PersonPhoto, ...]
    identity: Float[np.ndarray, " identities"]  # standard deviations
    albedo: Float[np.ndarray, " albedos"]  # coefficients
    specular: Float[np.ndarray, "cells cells"]  # c_spec over the UV square, row 0 at v = 1
    roughness: float
    timings: dict[str, float]
    folder: Path | None = None
    # Shared parameters without a field of their own, by name.
    further: dict[str, Any] = field(default_factory=dict)

    def write_into(self, folder: Path) -> None:
        """Write person.json into an existing folder."""
        data: dict[str, Any] = {"schema": SCHEMA_VERSION} | {
            name: value
            for name, value in (vars(self) | self.further).items()
            if name not in ("photos", "folder", "further")
        }
        data["photos"] = [asdict(photo) for photo in self.photos]
        write_json(folder / FILE, data)

    @classmethod
    def load(cls, folder: Path) -> Person:
        """Read a person's folder. Raises InputError naming what is wrong."""
        path = Path(folder) / FILE
        data, again = read_json(path, "person file"), "fit the photos again"
        check_version(data, SCHEMA_VERSION, f"The person file '{path}'", again)
        found = checked(PersonSchema(), data, f"The person file '{path}'", again)
        del found["schema"]
        photos = tuple(PersonPhoto(**photo) for photo in found.pop("photos"))
        return cls(photos=photos, folder=Path(folder), **as_fields(cls, found))


class PersonPhotoSchema(FileSchema):
    """One of the photos."""

    number = Whole(1, PHOTOS_MAX)
    image = PathText()
    folder = PathText()
    status = Choice(STATUSES)
    advice = Text()
    shares_shape = Flag()
    errors = Figures()


class PersonSchema(FileSchema):
    """A person.json."""

    class Meta(FileSchema.Meta):
        """Of marshmallow."""

        include: ClassVar = shared_values()

    dimensions: ClassVar = SIZES

    schema = Whole(SCHEMA_VERSION, SCHEMA_VERSION)
    status = Choice(STATUSES)
    advice = Text()
    model = Name()
    photos = Items(Part(PersonPhotoSchema, "a photo"), 1, PHOTOS_MAX)
    timings = Figures()
