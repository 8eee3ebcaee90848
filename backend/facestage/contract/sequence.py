"""A sequence: what was found of a performance, as a folder that appears whole or not at all."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from marshmallow import ValidationError, validates_schema

from facestage.contract.arrays import Float
from facestage.contract.camera import Camera, CameraSchema
from facestage.contract.corrections import CORRECTIONS_MAX, NUMBER_MAX, Correction, CorrectionSchema
from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_folder
from facestage.contract.files.storage import read_arrays, read_json, write_arrays, write_json
from facestage.contract.light_stage import FAR, RADIANCE_MAX
from facestage.contract.parameters import WEIGHT_MAX
from facestage.contract.result import NAMES_MAX, RESULT_ARRAYS_MAX, STATUSES
from facestage.contract.schemas.array_field import Array
from facestage.contract.schemas.fields import (
    Choice,
    Figures,
    Items,
    Name,
    Number,
    Part,
    PathText,
    Table,
    Text,
    Whole,
)
from facestage.contract.schemas.schema import FileSchema, check_version, checked, sections
from facestage.contract.wrinkles import WRINKLES_MAX, Wrinkles, WrinklesSchema

SCHEMA_VERSION = 1
FILE, ARRAYS, VERTICES = "sequence.json", "sequence.npz", "vertices.npy"
LIVE_LINK = "live_link.csv"  # where the model's expressions are ARKit's
KEYFRAMES = "keyframes"  # the folder of the person that the keyframes show, see person.py
FRAMES_MAX = 200_000
# Of files that are taken for films where photos might stand, too.
VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".wmv")
# The frame shows the face | it is doubtful, see its advice | no face was found: it follows others
SEEN, UNSURE, LOST = "seen", "unsure", "lost"
FRAME_STATUSES = (SEEN, UNSURE, LOST)
HAEMOGLOBIN = ("haemoglobin", "haemoglobin_harmonics", "haemoglobin_color")
HARMONICS_MAX = 48
_OPTIONAL = ("light_radiance", *HAEMOGLOBIN)
_WRITTEN_APART = ("deviations", "folder", "camera", "frames", "corrected", "wrinkles", *_OPTIONAL)


@dataclass(frozen=True)
class SequenceFrame:
    """One frame."""

    number: int  # of the picture's name, or 1, 2, ...
    time: float  # seconds since the first
    name: str
    status: str  # one of FRAME_STATUSES
    advice: str = ""  # empty where nothing is to be said
    shot: int = 1  # frames of another shot are on the other side of a cut
    photo_rms: float | None = None  # of photo minus fit, linear; None: not compared
    landmark_rms: float | None = None  # standard deviations of a single photo's landmarks


@dataclass(frozen=True)
class Sequence:
    """Pose and expression of every frame, of one person.

    ``deviations`` hold standard deviations by block: "expression" (F, e) and "pose" (F, 6), the
    last turn (radians, camera axes, about the model's origin) and place (metres).
    """

    status: str  # as of a result
    advice: str
    film: str  # path of the video or the folder
    model: str
    camera: Camera
    frame_rate: float  # a second
    frames: tuple[SequenceFrame, ...]
    keyframes: tuple[int, ...]  # numbers of the frames that the person was fitted to
    identity_names: tuple[str, ...]
    expression_names: tuple[str, ...]
    identity: Float[np.ndarray, " identities"]
    expression: Float[np.ndarray, "frames expressions"]
    model_to_camera: Float[np.ndarray, "frames 4 4"]
    deviations: dict[str, np.ndarray]
    motion: dict[str, float]  # what was learned of the motion: second differences, by group
    errors: dict[str, float]
    timings: dict[str, float]
    versions: dict[str, str] = field(default_factory=dict)
    folder: Path | None = None
    # Linear RGB of the first keyframe's lights in every frame; None: no frame needs another light.
    light_radiance: Float[np.ndarray, "frames lights 3"] | None = None
    corrected: tuple[Correction, ...] = ()  # by hand: what refits keep as it is
    # Haemoglobin in the skin beyond the texture's, where it comes and goes: in every frame, the
    # weights of functions over the model's vertices, of unit RMS over the face, in standard
    # deviations of a population; and what one of these adds to the log of linear RGB albedo.
    haemoglobin: Float[np.ndarray, "frames harmonics"] | None = None
    haemoglobin_harmonics: Float[np.ndarray, "harmonics vertices"] | None = None
    haemoglobin_color: Float[np.ndarray, " 3"] | None = None
    wrinkles: tuple[Wrinkles, ...] = ()  # where some come with an expression
    # How much was found of skin that changes, where it was asked for, and how much of it is noise.
    skin: dict[str, float] = field(default_factory=dict)

    def write_into(self, folder: Path) -> None:
        """Write sequence.json and sequence.npz into an existing folder."""
        arrays = ["identity", "expression", "model_to_camera"]
        arrays += [name for name in _OPTIONAL if getattr(self, name) is not None]
        others = {*arrays, *_WRITTEN_APART}
        data = {name: value for name, value in vars(self).items() if name not in others}
        data = {"schema": SCHEMA_VERSION} | data | {"camera": self.camera.to_json()}
        data["frames"] = [asdict(frame) for frame in self.frames]
        if self.corrected:
            data["corrected"] = [each.to_json() for each in self.corrected]
        if self.wrinkles:
            data["wrinkles"] = [each.to_json() for each in self.wrinkles]
        write_json(folder / FILE, data)
        deviations = {f"deviation/{name}": value for name, value in self.deviations.items()}
        write_arrays(folder / ARRAYS, {name: getattr(self, name) for name in arrays} | deviations)

    @classmethod
    def load(cls, folder: Path) -> Sequence:
        """Read a sequence's folder. Raises InputError naming what is wrong."""
        folder = Path(folder)
        if not is_folder(folder):
            raise InputError(f"The folder '{folder}' does not exist; run facestage track first.")
        data, again = read_json(folder / FILE, "sequence file"), "track the film again"
        subject = f"The sequence '{folder}'"
        check_version(data, SCHEMA_VERSION, subject, again)
        found = checked(SequenceSchema(), data, f"{subject} is damaged; its {FILE}", again)
        arrays = sections(
            read_arrays(folder / ARRAYS, "sequence's arrays", RESULT_ARRAYS_MAX), "deviation"
        )
        sizes = {
            "frames": len(found["frames"]),
            "identities": len(found["identity_names"]),
            "expressions": len(found["expression_names"]),
        }
        given = checked(
            SequenceArrays(**sizes), arrays, f"{subject} is damaged; its {ARRAYS}", again
        )
        del found["schema"]
        for name in ("identity_names", "expression_names", "keyframes"):
            found[name] = tuple(found[name])
        return cls(
            camera=Camera(**found.pop("camera")),
            frames=tuple(SequenceFrame(**frame) for frame in found.pop("frames")),
            corrected=tuple(Correction(**each) for each in found.pop("corrected")),
            wrinkles=tuple(Wrinkles(**each) for each in found.pop("wrinkles")),
            deviations=given.pop("deviation"),
            folder=folder,
            **given,
            **found,
        )


class FrameSchema(FileSchema):
    """One frame of a sequence.json."""

    number = Whole(0, NUMBER_MAX)
    time = Number(0)
    name = PathText()
    status = Choice(FRAME_STATUSES)
    advice = Text(load_default="")
    shot = Whole(1, NUMBER_MAX, load_default=1)
    photo_rms = Number(0, load_default=None, allow_none=True)
    landmark_rms = Number(0, load_default=None, allow_none=True)


class SequenceSchema(FileSchema):
    """A sequence.json."""

    schema = Whole(SCHEMA_VERSION, SCHEMA_VERSION)
    status = Choice(STATUSES)
    advice = Text()
    film = PathText()
    model = Name()
    camera = Part(CameraSchema, "a camera")
    frame_rate = Number(0)
    frames = Items(Part(FrameSchema, "a frame"), 1, FRAMES_MAX)
    keyframes = Items(Whole(0, NUMBER_MAX))
    identity_names = Items(Name(), 0, NAMES_MAX)
    expression_names = Items(Name(), 0, NAMES_MAX)
    motion = Figures()
    errors = Figures()
    timings = Figures()
    versions = Table(Text(), load_default=dict)
    corrected = Items(
        Part(CorrectionSchema, "a correction"), 0, CORRECTIONS_MAX, load_default=tuple
    )
    skin = Figures(load_default=dict)
    wrinkles = Items(Part(WrinklesSchema, "wrinkles"), 0, WRINKLES_MAX, load_default=tuple)

    @validates_schema
    def _whole_wrinkles(self, data: dict[str, Any], **_: Any) -> None:
        known, names = set(data["expression_names"]), [each["name"] for each in data["wrinkles"]]
        if len(set(names)) < len(names):
            raise ValidationError({"wrinkles": ["have a name twice, expected each once"]})
        for each in data["wrinkles"]:
            for slider in each["sliders"]:
                if slider not in known:
                    words = f"follow '{slider}', which is no expression of the sequence"
                    raise ValidationError({"wrinkles": [words]})


class SequenceArrays(FileSchema):
    """A sequence.npz. Deviations may be infinite, and are only shown."""

    identity = Array(("identities",), minimum=-WEIGHT_MAX, maximum=WEIGHT_MAX)
    expression = Array(("frames", "expressions"), minimum=-WEIGHT_MAX, maximum=WEIGHT_MAX)
    model_to_camera = Array(("frames", 4, 4), minimum=-FAR, maximum=FAR)
    light_radiance = Array(("frames", "lights", 3), minimum=0, maximum=RADIANCE_MAX, required=False)
    haemoglobin = Array(
        ("frames", "harmonics"), minimum=-WEIGHT_MAX, maximum=WEIGHT_MAX, required=False
    )
    haemoglobin_harmonics = Array(
        ("harmonics", "vertices"), minimum=-WEIGHT_MAX, maximum=WEIGHT_MAX, required=False
    )
    haemoglobin_color = Array((3,), minimum=-WEIGHT_MAX, maximum=WEIGHT_MAX, required=False)
    deviation = Table(Array(None, finite=False), load_default=dict)

    dimensions: ClassVar = {"harmonics": (1, HARMONICS_MAX)}

    @validates_schema
    def _whole_haemoglobin(self, data: dict[str, Any], **_: Any) -> None:
        lacking = [name for name in HAEMOGLOBIN if name not in data]
        if lacking and len(lacking) < len(HAEMOGLOBIN):
            raise ValidationError({lacking[0]: ["is missing, beside others of its kind"]})

    @validates_schema
    def _rigid(self, data: dict[str, Any], **_: Any) -> None:
        rotation = data["model_to_camera"][:, :3, :3]
        square = rotation @ rotation.transpose(0, 2, 1)
        if not np.allclose(square, np.eye(3), atol=1e-4) or (np.linalg.det(rotation) < 0).any():
            raise ValidationError({"model_to_camera": ["holds what is no rigid transform"]})
