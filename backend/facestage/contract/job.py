"""A job: everything a fit needs, as a folder that the backend reads and never writes to."""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.atomic import atomic_folder
from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import LIGHT_ARRAYS, LightStage
from facestage.contract.quality import GOOD, QUALITIES
from facestage.contract.storage import read_arrays, read_json, write_arrays, write_json

SCHEMA_VERSION = 1
PARAMETERS = ("identity", "expression", "pose", "albedo", "specular", "roughness", "lights", "light_position", "focal")
LIGHT_COLORS = ("multi", "uniform")
DEVICES = ("auto", "cpu", "cuda")
SEED_MAX = 10**9
LEAN, FULL = "lean", "full"  # leave out what the scene does not need | work on everything
PLANS = (LEAN, FULL)


@dataclass(frozen=True)
class Weights:
    """Factors on the terms of the energy; 1 is the balance estimated from the data."""

    photo: float = 1.0
    landmarks: float = 1.0
    prior: float = 1.0
    light: float = 1.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (math.isfinite(value) and value >= 0):
                raise InputError(f"The weight '{name}' is {value}; expected a number of 0 or more.")


@dataclass(frozen=True)
class Job:
    """One photograph to fit. Paths are absolute once loaded.

    ``stage`` is in the stage frame. ``camera_to_stage`` (4, 4) fixes the camera in the stage; None
    lets the backend centre the stage on the face, its axes parallel to the camera's.
    ``initial`` holds starting values by name ("identity", "expression", "albedo", ...), optional.
    ``plan``: "lean" leaves out what cannot matter to this job, "full" works on everything; the answer is the same.
    """

    image: Path
    model: str = "default"
    landmarks: Landmarks | None = None
    camera: Camera | None = None
    stage: LightStage | None = None
    camera_to_stage: np.ndarray | None = None
    light_color: str = "multi"
    freeze: tuple[str, ...] = ()
    weights: Weights = field(default_factory=Weights)
    initial: dict[str, np.ndarray] = field(default_factory=dict)
    budget_seconds: float | None = None
    seed: int = 0
    device: str = "auto"
    truth: Path | None = None
    plan: str = LEAN
    quality: str = GOOD
    face: int | None = None  # which face to find where landmarks is None: 1 is the largest, as is None

    def __post_init__(self) -> None:
        if self.light_color not in LIGHT_COLORS:
            raise InputError(f"light_color is '{self.light_color}'; expected one of {', '.join(LIGHT_COLORS)}.")
        if self.device not in DEVICES:
            raise InputError(f"device is '{self.device}'; expected one of {', '.join(DEVICES)}.")
        if self.plan not in PLANS:
            raise InputError(f"The plan is '{self.plan}'; expected one of {', '.join(PLANS)}.")
        if self.quality not in QUALITIES:
            raise InputError(f"The quality is '{self.quality}'; expected one of {', '.join(QUALITIES)}.")
        unknown = sorted(set(self.freeze) - set(PARAMETERS))
        if unknown:
            raise InputError(f"Cannot freeze '{unknown[0]}'; expected one of {', '.join(PARAMETERS)}.")
        if self.budget_seconds is not None and not (math.isfinite(self.budget_seconds) and self.budget_seconds > 0):
            raise InputError(f"The budget is {self.budget_seconds} seconds; expected a number greater than 0.")

        if self.face is not None and self.face < 1:
            raise InputError(f"The face is {self.face}; expected a whole number, 1 for the largest face of the photo.")
        if not 0 <= self.seed <= SEED_MAX:
            raise InputError(f"The seed is {self.seed}; expected a whole number of 0 to {SEED_MAX}.")

    def save(self, folder: Path) -> None:
        """Write job.json, job.npz and a copy of the image as a folder, whole or not at all."""
        with atomic_folder(Path(folder)) as temporary:
            self.write_into(temporary, copy_image=True)

    def write_into(self, folder: Path, copy_image: bool) -> None:
        """Write the job's files into an existing folder (a result keeps its job this way)."""
        image = str(self.image)
        if copy_image:
            image = f"photo{self.image.suffix.lower()}"
            shutil.copyfile(self.image, folder / image)
        data: dict[str, Any] = {
            "schema": SCHEMA_VERSION, "image": image, "model": self.model,
            "landmarks": self.landmarks.to_json() if self.landmarks else None,
            "camera": self.camera.to_json() if self.camera else None,
            "light_color": self.light_color, "freeze": list(self.freeze), "weights": vars(self.weights),
            "budget_seconds": self.budget_seconds, "seed": self.seed, "device": self.device,
            "truth": str(self.truth) if self.truth else None, "plan": self.plan, "quality": self.quality,
            "face": self.face,
        }  # fmt: skip
        arrays = {f"initial/{name}": np.asarray(value) for name, value in self.initial.items()}
        if self.camera_to_stage is not None:
            arrays["camera_to_stage"] = np.asarray(self.camera_to_stage, np.float64)
        if self.stage is not None:
            arrays |= {f"stage/{name}": getattr(self.stage, name) for name in LIGHT_ARRAYS}
        write_json(folder / "job.json", data)
        write_arrays(folder / "job.npz", arrays)

    @classmethod
    def load(cls, folder: Path) -> Job:
        """Read a job folder. Raises InputError naming the file and the value that is wrong."""
        folder = Path(folder)
        if not folder.is_dir():
            raise InputError(f"The job folder '{folder}' does not exist; expected a folder with job.json and job.npz.")
        data = read_json(folder / "job.json", "job file")
        if data.get("schema") != SCHEMA_VERSION:
            raise InputError(f"The job '{folder}' has schema {data.get('schema')}, expected {SCHEMA_VERSION}.")
        arrays = read_arrays(folder / "job.npz", "job's arrays")
        stage = None
        if "stage/position" in arrays:
            missing = [name for name in LIGHT_ARRAYS if f"stage/{name}" not in arrays]
            if missing:
                raise InputError(f"The job '{folder}' lacks the stage's {', '.join(missing)}; export it again.")
            stage = LightStage(**{name: arrays[f"stage/{name}"] for name in LIGHT_ARRAYS})
        try:
            return cls(
                image=folder / str(data["image"]),
                model=str(data.get("model", "default")),
                landmarks=Landmarks.from_json(data["landmarks"]) if data.get("landmarks") else None,
                camera=Camera.from_json(data["camera"]) if data.get("camera") else None,
                stage=stage,
                camera_to_stage=_rigid(arrays.get("camera_to_stage")),
                light_color=str(data.get("light_color", "multi")),
                freeze=tuple(data.get("freeze", ())),
                weights=Weights(**data.get("weights", {})),
                initial={name[8:]: array for name, array in arrays.items() if name.startswith("initial/")},
                budget_seconds=data.get("budget_seconds"),
                seed=int(data.get("seed", 0)),
                device=str(data.get("device", "auto")),
                truth=Path(data["truth"]) if data.get("truth") else None,
                plan=str(data.get("plan", LEAN)),
                quality=str(data.get("quality", GOOD)),
                face=int(data["face"]) if data.get("face") is not None else None,
            )
        except (KeyError, TypeError, ValueError, AttributeError) as error:
            raise InputError(f"The job file '{folder / 'job.json'}' has a missing or wrong value ({error}).") from error


def _rigid(matrix: np.ndarray | None) -> np.ndarray | None:
    """The 4x4 matrix, checked to be a rotation and a translation."""
    if matrix is None:
        return None
    if (
        matrix.shape != (4, 4)
        or not np.issubdtype(matrix.dtype, np.number)
        or not np.isfinite(matrix).all()
        or not np.allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-4)
        or np.linalg.det(matrix[:3, :3]) < 0
    ):
        raise InputError("camera_to_stage is not a rigid 4x4 transform (rotation and translation, no scale).")
    return matrix
