"""What a fit of several photos of one person says beside each photo's own result: person.json."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.storage import read_json, write_json

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
    """The shared parameters, and the photos that they were fitted to. ``folder`` holds albedo.exr and person.html."""

    status: str  # converged, budget_spent or stopped, as in a result
    advice: str
    model: str
    photos: tuple[PersonPhoto, ...]
    identity: np.ndarray  # (k,) standard deviations
    albedo: np.ndarray  # (d,) coefficients
    specular: np.ndarray  # (s, s) c_spec over the UV square, row 0 at v = 1
    roughness: float
    timings: dict[str, float]
    folder: Path | None = None

    def write_into(self, folder: Path) -> None:
        """Write person.json into an existing folder."""
        data: dict[str, Any] = {"schema": SCHEMA_VERSION} | {
            name: value for name, value in vars(self).items() if name not in ("photos", "folder")
        }
        data["photos"] = [asdict(photo) for photo in self.photos]
        write_json(folder / FILE, data)

    @classmethod
    def load(cls, folder: Path) -> Person:
        """Read a person's folder. Raises InputError naming what is wrong."""
        path = Path(folder) / FILE
        data = read_json(path, "person file")
        if data.pop("schema", None) != SCHEMA_VERSION:
            raise InputError(
                f"The person file '{path}' has another schema than {SCHEMA_VERSION}; fit the photos again."
            )
        try:
            photos = tuple(PersonPhoto(**photo) for photo in data.pop("photos"))
            for name in ("identity", "albedo", "specular"):
                data[name] = np.array(data[name], float)
            return cls(photos=photos, folder=Path(folder), **data)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"The person file '{path}' has a missing or wrong value ({error}).") from error
