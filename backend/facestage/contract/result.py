"""A result: what a fit found, as a folder that appears whole or not at all."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from marshmallow import ValidationError, validates_schema

from facestage.contract.arrays import Float, Integer
from facestage.contract.camera import Camera, CameraSchema
from facestage.contract.certainty import DEVIATION
from facestage.contract.errors import InputError
from facestage.contract.files.atomic import read_consistently
from facestage.contract.files.paths import is_folder
from facestage.contract.files.reading import MIB
from facestage.contract.files.storage import read_arrays, read_json, write_arrays, write_json
from facestage.contract.folds import PLACE, PLACES, PULL, Folds
from facestage.contract.job import SEED_MAX
from facestage.contract.light_stage import FAR, LIGHT_ARRAYS, LightStage, StageSchema
from facestage.contract.parameters import KEPT, SIZES, WEIGHT_MAX, as_fields, result_arrays
from facestage.contract.schemas.array_field import WHOLE, Array, rigid
from facestage.contract.schemas.fields import (
    Choice,
    Figures,
    Items,
    Name,
    Number,
    Part,
    Plain,
    Table,
    Text,
    Whole,
)
from facestage.contract.schemas.schema import FileSchema, check_version, checked, sections
from facestage.contract.texture_maps import TEXTURE_MAPS

SCHEMA_VERSION = 1
# Nothing speaks against the fit | the time ended first | the advice says what does.
CONVERGED, BUDGET_SPENT, STOPPED = "converged", "budget_spent", "stopped"
STATUSES = (CONVERGED, BUDGET_SPENT, STOPPED)
FILE, ARRAYS = "result.json", "result.npz"
RESULT_ARRAYS_MAX = 512 * MIB
TEXTURE_MAX = 512 * MIB  # of a picture's file
VERTICES_MAX, NAMES_MAX = 5_000_000, 10_000
RENDER, LIGHT_PROBE = "render.exr", "light_probe.exr"
# The pictures of every result; newer ones have the other texture maps too, and COVERAGE: where
# their texels are from.
PICTURES = (*(each.file for each in TEXTURE_MAPS if each.required), RENDER, LIGHT_PROBE)
COVERAGE = "coverage.png"
RELIEF = "relief"  # of the extra arrays
# The red channel of COVERAGE; 0: the model's own.
SEEN, BY_SYMMETRY = 255, 128


@dataclass(frozen=True)
class Result:
    """The fitted face.

    ``folder`` holds the pictures named in PICTURES, all texture maps, COVERAGE and the report.
    """

    status: str  # CONVERGED, BUDGET_SPENT or STOPPED
    advice: str  # one sentence: what it means and what to do
    model: str  # the job's model, "default", "ict:PATH", ...
    camera: Camera
    camera_to_stage: Float[np.ndarray, "4 4"]
    model_to_camera: Float[np.ndarray, "4 4"]  # the head pose
    identity: Float[np.ndarray, " identities"]  # standard deviations
    expression: Float[np.ndarray, " expressions"]  # weights
    albedo: Float[np.ndarray, " albedos"]  # coefficients delta
    specular: Float[np.ndarray, "cells cells"]  # c_spec over the UV square, row 0 at v = 1
    roughness: float  # GGX alpha = roughness^2
    stage: LightStage  # stage frame
    vertices: Float[np.ndarray, "vertices 3"]  # m, camera frame, the model's vertex order
    triangles: Integer[np.ndarray, "triangles 3"]
    identity_names: tuple[str, ...] = ()
    expression_names: tuple[str, ...] = ()
    energy: dict[str, float] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)
    timings: dict[str, float] = field(default_factory=dict)
    left_out: list[dict[str, Any]] = field(default_factory=list)
    # Block -> names of the parameters that rest on their prior alone: photo and landmarks say
    # nothing of them.
    unobserved: dict[str, list[str]] = field(default_factory=dict)
    # What the normal equations leave open: "count" of "of" directions, "by_block", and "sentences"
    # that name them.
    null_directions: dict[str, Any] = field(default_factory=dict)
    # What the fit took from the photo and its file, in words: its "size" and "color" space, where
    # "focal" comes from, and what was found of the lights before they were fitted ("light").
    photo: dict[str, str] = field(default_factory=dict)
    # The face model's "name", "license" and "source"; none in results of an older version.
    model_origin: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    seed: int = 0
    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    folder: Path | None = None
    # Parameters without a field of their own, by name.
    further: dict[str, Any] = field(default_factory=dict)

    @property
    def parameters(self) -> dict[str, np.ndarray]:
        """All that is kept as numbers of its own; what an older version did not know is missing."""
        values = vars(self) | self.further
        return {name: np.asarray(values[name]) for name in KEPT if name in values}

    @property
    def relief(self) -> Float[np.ndarray, "vertices 3"] | None:
        """Metres in the model's frame by which the vertices differ from the shape that identity and
        expression say, in the model's order; None where they do not.
        """
        return self.arrays.get(RELIEF)

    @property
    def folds(self) -> Folds | None:
        """What the folds in the albedo follow, where the photo's expression made some."""
        return Folds.of(self.arrays)

    @property
    def model_to_stage(self) -> Float[np.ndarray, "4 4"]:
        """The head pose in the stage."""
        return self.camera_to_stage @ self.model_to_camera

    def write_into(self, folder: Path) -> None:
        """Write result.json and result.npz into an existing folder."""
        data = {
            "schema": SCHEMA_VERSION,
            "status": self.status,
            "advice": self.advice,
            "model": self.model,
            "camera": self.camera.to_json(),
            "seed": self.seed,
            "roughness": self.roughness,
            "identity": dict(zip(self.identity_names, self.identity.tolist(), strict=True)),
            "expression": dict(zip(self.expression_names, self.expression.tolist(), strict=True)),
            "pose": {
                "model_to_camera": self.model_to_camera,
                "camera_to_stage": self.camera_to_stage,
            },
            "lights": [
                {"position": p, "direction": d, "side": s, "radiance": r, "state": int(state)}
                for p, d, s, r, state in zip(
                    self.stage.position,
                    self.stage.direction,
                    self.stage.side,
                    self.stage.radiance,
                    self.stage.state,
                    strict=True,
                )
            ],
            "energy": self.energy,
            "errors": self.errors,
            "timings": self.timings,
            "left_out": self.left_out,
            "unobserved": self.unobserved,
            "null_directions": self.null_directions,
            "photo": self.photo,
            "model_origin": self.model_origin,
            "versions": self.versions,
        }
        write_json(folder / FILE, data)
        arrays: dict[str, np.ndarray] = {
            "vertices": self.vertices.astype(np.float32),
            "triangles": self.triangles.astype(np.int32),
            "model_to_camera": self.model_to_camera,
            "camera_to_stage": self.camera_to_stage,
        }
        arrays |= self.parameters
        arrays |= {f"stage/{name}": getattr(self.stage, name) for name in LIGHT_ARRAYS}
        arrays |= {f"extra/{name}": value for name, value in self.arrays.items()}
        write_arrays(folder / ARRAYS, arrays)

    @classmethod
    def load(cls, folder: Path) -> Result:
        """Read a result folder. Raises InputError when anything in it is missing, of another
        version, or not possible.

        What comes back can be applied: shapes agree, numbers are finite and within bounds,
        transforms are rigid.
        """
        return read_consistently(Path(folder), cls._read)

    @classmethod
    def _read(cls, folder: Path) -> Result:
        if not is_folder(folder):
            raise InputError(f"The result folder '{folder}' does not exist; run a fit first.")
        data = read_json(folder / FILE, "result file")
        subject, again = f"The result '{folder}'", "run the fit again"
        check_version(data, SCHEMA_VERSION, subject, again)
        found = checked(ResultSchema(), data, f"{subject} is damaged; its result.json", again)
        shapes = {"identity": len(found["identity"]), "expression": len(found["expression"])}
        arrays = sections(
            read_arrays(folder / ARRAYS, "result's arrays", RESULT_ARRAYS_MAX), "stage", "extra"
        )
        given = checked(
            ResultArrays(**shapes), arrays, f"{subject} is damaged; its result.npz", again
        )
        for name in shapes:
            said = np.array(list(found[name].values()), np.float64)
            if not np.allclose(said, given[name], rtol=1e-5, atol=1e-7):
                raise InputError(
                    f"{subject} is damaged; its result.json and its result.npz have another "
                    f"{name}; {again}."
                )
        identity_names, expression_names = (
            tuple(found.pop("identity")),
            tuple(found.pop("expression")),
        )
        del found["schema"]
        found["left_out"] = list(found["left_out"])
        found["unobserved"] = {block: list(names) for block, names in found["unobserved"].items()}
        parameters = {name: given.pop(name) for name in KEPT if name in given}
        parameters["roughness"] = float(parameters["roughness"])
        return cls(
            camera=Camera(**found.pop("camera")),
            stage=LightStage(**given.pop("stage")),
            arrays=given.pop("extra"),
            identity_names=identity_names,
            expression_names=expression_names,
            folder=folder,
            **as_fields(cls, parameters),
            **given,
            **found,
        )


class ResultSchema(FileSchema):
    """A result.json; the names of its weights are those of the face model."""

    schema = Whole(SCHEMA_VERSION, SCHEMA_VERSION)
    status = Choice(STATUSES)
    advice = Text()
    model = Name()
    camera = Part(CameraSchema, "a camera")
    seed = Whole(0, SEED_MAX)
    identity = Table(Number(-WEIGHT_MAX, WEIGHT_MAX), NAMES_MAX)
    expression = Table(Number(-WEIGHT_MAX, WEIGHT_MAX), NAMES_MAX)
    energy = Figures()
    errors = Figures()
    timings = Figures()
    left_out = Items(Table(Plain()))
    unobserved = Table(Items(Text()), load_default=dict)
    null_directions = Table(Plain(), load_default=dict)
    photo = Table(Text(), load_default=dict)
    model_origin = Table(Text(), load_default=dict)
    versions = Table(Text())


class ResultArrays(FileSchema):
    """A result.npz. Deviations may be infinite, and are only shown."""

    class Meta(FileSchema.Meta):
        """Of marshmallow."""

        include: ClassVar = result_arrays()

    dimensions: ClassVar = {**SIZES, "vertices": (3, VERTICES_MAX)}

    model_to_camera = Array((4, 4), minimum=-FAR, maximum=FAR, validate=rigid)
    camera_to_stage = Array((4, 4), minimum=-FAR, maximum=FAR, validate=rigid)
    stage = Part(StageSchema, "a light stage")
    vertices = Array(("vertices", 3), minimum=-FAR, maximum=FAR)
    triangles = Array(("triangles", 3), WHOLE, minimum=0)
    extra = Table(Array(None, finite=False), load_default=dict)

    @validates_schema
    def _within(self, data: dict[str, Any], **_: Any) -> None:
        triangles, count = data["triangles"], len(data["vertices"])
        if triangles.size and triangles.max() >= count:
            raise ValidationError(
                {"triangles": [f"holds {triangles.max()}, expected vertices of 0 to {count - 1}"]}
            )
        shapes = {
            DEVIATION: (count, 3),
            RELIEF: (count, 3),
            PLACE: (count, len(PLACES)),
            PULL: (len(PLACES), len(data["expression"])),
        }
        for name, shape in shapes.items():
            each = data["extra"].get(name)
            if each is not None and each.shape != shape:
                words = f"has shape {each.shape}, expected {shape}"
                raise ValidationError({"extra": {name: [words]}})
        for name in (RELIEF, PLACE, PULL):
            each = data["extra"].get(name)
            # NaN is not below either.
            if each is not None and not (np.abs(each) <= FAR).all():
                words = f"holds numbers beyond {FAR:g}, or none"
                raise ValidationError({"extra": {name: [words]}})
