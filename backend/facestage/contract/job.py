"""A job: everything a fit needs, as a folder that the backend reads and never writes to."""

from __future__ import annotations

import math
import shutil
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.camera import Camera, CameraSchema
from facestage.contract.errors import InputError
from facestage.contract.files.atomic import atomic_folder
from facestage.contract.files.paths import is_folder, user_path
from facestage.contract.files.reading import MIB
from facestage.contract.files.storage import read_arrays, read_json, write_arrays, write_json
from facestage.contract.grey import check_white_balance
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import FAR, LIGHT_ARRAYS, RADIANCE_MAX, LightStage, StageSchema
from facestage.contract.parameters import PARAMETERS
from facestage.contract.pins import Pins
from facestage.contract.quality import GOOD, QUALITIES
from facestage.contract.schemas.array_field import Array, rigid
from facestage.contract.schemas.fields import (
    Choice,
    Items,
    Name,
    Number,
    Part,
    PathText,
    Plain,
    Table,
    Whole,
)
from facestage.contract.schemas.schema import (
    FileSchema,
    HandWritten,
    check_version,
    checked,
    sections,
)
from facestage.contract.skin_tone import ANGLES, check_skin_tone

SCHEMA_VERSION = 1
FILE, ARRAYS = "job.json", "job.npz"
DEFAULT_MODEL = "default"
MODEL_FORMS = "default, ict:PATH, flame:PATH, bfm:PATH, gnm:PATH, npz:PATH or rig:FILE"
LIGHT_COLORS = ("multi", "uniform")
DEVICES = ("auto", "cpu", "cuda")
# Of photos that are read; by content they may be BMP, too.
PHOTO_SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".tif", ".tiff", ".exr")
SEED_MAX = 10**9
FACE_MAX = 10**6
WEIGHT_MAX, BUDGET_MAX = 1e9, 1e9
JOB_ARRAYS_MAX = 64 * MIB
LEAN, FULL = "lean", "full"  # leave out what the scene does not need | work on everything
PLANS = (LEAN, FULL)
# Lights behind the face, beside those of the stage: where the photo needs them | always | never
AUTO, WITH, WITHOUT = "auto", "on", "off"
SURROUNDS = (AUTO, WITH, WITHOUT)
TEXTURE_SIZES = (512, 1024, 2048, 4096)
USUAL_TEXTURE_SIZE, DRAFT_TEXTURE_SIZE = 2048, 1024  # at most, where a job does not say
# What is known of the radiance of lights that are held: all | all but one factor, the photo's
# exposure
KNOWN, UNKNOWN = "known", "unknown"
EXPOSURES = (KNOWN, UNKNOWN)


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
    ``plan``: "lean" leaves out what cannot matter to this job, "full" works on everything; the
    answer is the same.
    """

    image: Path
    model: str = DEFAULT_MODEL
    landmarks: Landmarks | None = None
    camera: Camera | None = None
    stage: LightStage | None = None
    camera_to_stage: Float[np.ndarray, "4 4"] | None = None
    light_color: str = "multi"
    freeze: tuple[str, ...] = ()
    weights: Weights = field(default_factory=Weights)
    initial: dict[str, np.ndarray] = field(default_factory=dict)
    budget_seconds: float | None = None
    seed: int = 0
    device: str = "auto"
    truth: Path | None = None
    # which vertices are the face, where ``truth`` is a scan that does not say so itself
    face_region: Path | None = None
    plan: str = LEAN
    quality: str = GOOD
    # which face to find where landmarks is None: 1 is the largest, as is None
    face: int | None = None
    # whether lights behind the face join those of the stage: one of SURROUNDS
    surround: str = AUTO
    exposure: str = KNOWN  # of the lights that are held: one of EXPOSURES
    # Something grey in the photo: its pixel (x, y), or what it shows, linear (red, green, blue)
    white_balance: tuple[float, ...] | None = None
    skin_tone: float | None = None  # how light the skin is: its typology angle in degrees
    # the most texels along the textures, one of TEXTURE_SIZES; None: the usual
    texture_size: int | None = None
    pins: Pins | None = None  # points of the model's surface that were put on their pixels by hand

    def __post_init__(self) -> None:
        if self.light_color not in LIGHT_COLORS:
            raise InputError(
                f"light_color is '{self.light_color}'; expected one of {', '.join(LIGHT_COLORS)}."
            )
        if self.device not in DEVICES:
            raise InputError(f"device is '{self.device}'; expected one of {', '.join(DEVICES)}.")
        if self.plan not in PLANS:
            raise InputError(f"The plan is '{self.plan}'; expected one of {', '.join(PLANS)}.")
        if self.surround not in SURROUNDS:
            raise InputError(
                f"The surround is '{self.surround}'; expected one of {', '.join(SURROUNDS)}."
            )
        if self.texture_size is not None and self.texture_size not in TEXTURE_SIZES:
            known = ", ".join(map(str, TEXTURE_SIZES))
            raise InputError(
                f"The texture size is {self.texture_size}; expected one of {known}, or none."
            )
        if self.exposure not in EXPOSURES:
            raise InputError(
                f"The exposure is '{self.exposure}'; expected one of {', '.join(EXPOSURES)}."
            )
        if self.quality not in QUALITIES:
            raise InputError(
                f"The quality is '{self.quality}'; expected one of {', '.join(QUALITIES)}."
            )
        unknown = sorted(set(self.freeze) - set(PARAMETERS))
        if unknown:
            raise InputError(
                f"Cannot freeze '{unknown[0]}'; expected one of {', '.join(PARAMETERS)}."
            )
        if self.white_balance is not None:
            check_white_balance(self.white_balance)
        if self.skin_tone is not None:
            check_skin_tone(self.skin_tone)
        if self.budget_seconds is not None and not (
            math.isfinite(self.budget_seconds) and self.budget_seconds > 0
        ):
            raise InputError(
                f"The budget is {self.budget_seconds} seconds; expected a number greater than 0."
            )

        if self.face is not None and self.face < 1:
            raise InputError(
                f"The face is {self.face}; expected a whole number, 1 for the largest face of "
                "the photo."
            )
        if not 0 <= self.seed <= SEED_MAX:
            raise InputError(
                f"The seed is {self.seed}; expected a whole number of 0 to {SEED_MAX}."
            )

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
            "schema": SCHEMA_VERSION,
            "image": image,
            "model": self.model,
            "landmarks": self.landmarks.to_json() if self.landmarks else None,
            "camera": self.camera.to_json() if self.camera else None,
            "light_color": self.light_color,
            "freeze": list(self.freeze),
            "weights": vars(self.weights),
            "budget_seconds": self.budget_seconds,
            "seed": self.seed,
            "device": self.device,
            "truth": str(self.truth) if self.truth else None,
            "face_region": str(self.face_region) if self.face_region else None,
            "plan": self.plan,
            "quality": self.quality,
            "face": self.face,
            "surround": self.surround,
            "exposure": self.exposure,
            "white_balance": None if self.white_balance is None else list(self.white_balance),
            "skin_tone": self.skin_tone,
            "texture_size": self.texture_size,
            "pins": self.pins.to_json() if self.pins else None,
        }
        arrays = {f"initial/{name}": np.asarray(value) for name, value in self.initial.items()}
        if self.camera_to_stage is not None:
            arrays["camera_to_stage"] = np.asarray(self.camera_to_stage, np.float64)
        if self.stage is not None:
            arrays |= {f"stage/{name}": getattr(self.stage, name) for name in LIGHT_ARRAYS}
        write_json(folder / FILE, data)
        write_arrays(folder / ARRAYS, arrays)

    @classmethod
    def load(cls, folder: Path) -> Job:
        """Read a job folder. Raises InputError naming the file and the value that is wrong."""
        folder = Path(folder)
        if not is_folder(folder):
            raise InputError(
                f"The job folder '{folder}' does not exist; expected a folder with job.json "
                "and job.npz."
            )
        path = folder / FILE
        data = read_json(path, "job file")
        check_version(data, SCHEMA_VERSION, f"The job file '{path}'", "export it again")
        found = checked(JobSchema(), data, f"The job file '{path}'")
        arrays = sections(
            read_arrays(folder / ARRAYS, "job's arrays", JOB_ARRAYS_MAX), "stage", "initial"
        )
        given = checked(
            JobArrays(), arrays, f"The job's arrays '{folder / 'job.npz'}'", "export the job again"
        )
        landmarks, stage = found["landmarks"], given["stage"]
        user_path(found["model"].partition(":")[2] or ".", f"face model's path in '{path}'")
        return cls(
            image=user_path(folder / found["image"], f"photo's path in '{path}'"),
            model=found["model"],
            landmarks=None
            if landmarks is None
            else Landmarks.from_json(landmarks, f"job file '{path}' (landmarks)"),
            camera=None if found["camera"] is None else Camera(**found["camera"]),
            stage=None if stage is None else LightStage(**stage),
            camera_to_stage=given["camera_to_stage"],
            light_color=found["light_color"],
            freeze=found["freeze"],
            weights=Weights(**found["weights"]),
            initial=given["initial"],
            budget_seconds=found["budget_seconds"],
            seed=found["seed"],
            device=found["device"],
            truth=None
            if found["truth"] is None
            else user_path(found["truth"], f"truth file's path in '{path}'"),
            face_region=None
            if found["face_region"] is None
            else user_path(found["face_region"], f"face region's path in '{path}'"),
            plan=found["plan"],
            quality=found["quality"],
            face=found["face"],
            surround=found["surround"],
            exposure=found["exposure"],
            white_balance=found["white_balance"],
            skin_tone=found["skin_tone"],
            texture_size=found["texture_size"],
            pins=None
            if found["pins"] is None
            else Pins.from_json(found["pins"], f"job file '{path}' (pins)"),
        )


class WeightSchema(HandWritten):
    """The weights of the energy's terms."""

    photo = Number(0, WEIGHT_MAX, load_default=1.0)
    landmarks = Number(0, WEIGHT_MAX, load_default=1.0)
    prior = Number(0, WEIGHT_MAX, load_default=1.0)
    light = Number(0, WEIGHT_MAX, load_default=1.0)


class JobSchema(HandWritten):
    """A job.json: an option that is not known would silently not count."""

    schema = Whole(SCHEMA_VERSION, SCHEMA_VERSION)
    image = PathText()
    model = Name(load_default=DEFAULT_MODEL)
    landmarks = Table(Plain(), load_default=None)
    camera = Part(CameraSchema, "a camera", load_default=None)
    light_color = Choice(LIGHT_COLORS, load_default="multi")
    freeze = Items(Choice(PARAMETERS), load_default=())
    weights = Part(WeightSchema, "an object of weights", load_default=dict)
    budget_seconds = Number(0, BUDGET_MAX, load_default=None)
    seed = Whole(0, SEED_MAX, load_default=0)
    device = Choice(DEVICES, load_default="auto")
    truth = PathText(load_default=None)
    face_region = PathText(load_default=None)
    plan = Choice(PLANS, load_default=LEAN)
    quality = Choice(QUALITIES, load_default=GOOD)
    face = Whole(1, FACE_MAX, load_default=None)
    surround = Choice(SURROUNDS, load_default=AUTO)
    exposure = Choice(EXPOSURES, load_default=KNOWN)
    white_balance = Items(Number(0, RADIANCE_MAX), 2, 3, load_default=None)
    skin_tone = Number(*ANGLES, load_default=None)
    texture_size = Whole(TEXTURE_SIZES[0], TEXTURE_SIZES[-1], load_default=None)
    pins = Table(Plain(), load_default=None)


class JobArrays(FileSchema):
    """A job.npz."""

    stage = Part(StageSchema, "a light stage", load_default=None)
    camera_to_stage = Array((4, 4), minimum=-FAR, maximum=FAR, validate=rigid, load_default=None)
    initial = Table(Array(None), load_default=dict)
