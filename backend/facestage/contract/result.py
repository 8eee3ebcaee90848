"""A result: what a fit found, as a folder that appears whole or not at all."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.atomic import read_consistently
from facestage.contract.camera import Camera
from facestage.contract.errors import InputError
from facestage.contract.light_stage import LIGHT_ARRAYS, LightStage
from facestage.contract.storage import read_arrays, read_json, write_arrays, write_json

SCHEMA_VERSION = 1
# Nothing speaks against the fit | the time ended first | the advice says what does.
CONVERGED, BUDGET_SPENT, STOPPED = "converged", "budget_spent", "stopped"
PICTURES = ("albedo.exr", "specular.exr", "render.exr", "light_probe.exr")
# Maps that older results lack: they have one roughness, and say nothing of where their texels are from.
ROUGHNESS, COVERAGE = "roughness.exr", "coverage.png"
# The red channel of COVERAGE; 0: the model's own.
SEEN, BY_SYMMETRY = 255, 128


@dataclass(frozen=True)
class Result:
    """The fitted face. ``folder`` holds the pictures named in PICTURES, ROUGHNESS and COVERAGE, and the report."""

    status: str  # CONVERGED, BUDGET_SPENT or STOPPED
    advice: str  # one sentence: what it means and what to do
    model: str  # the job's model, "default", "ict:PATH", ...
    camera: Camera
    camera_to_stage: np.ndarray  # (4, 4)
    model_to_camera: np.ndarray  # (4, 4), the head pose
    identity: np.ndarray  # (k,) standard deviations
    expression: np.ndarray  # (e,) weights
    albedo: np.ndarray  # (d,) coefficients delta
    specular: np.ndarray  # (s, s) c_spec over the UV square, row 0 at v = 1
    roughness: float  # GGX alpha = roughness^2
    stage: LightStage  # stage frame
    vertices: np.ndarray  # (n, 3) float32 m, camera frame, the model's vertex order
    triangles: np.ndarray  # (t, 3) int32
    identity_names: tuple[str, ...] = ()
    expression_names: tuple[str, ...] = ()
    energy: dict[str, float] = field(default_factory=dict)
    errors: dict[str, float] = field(default_factory=dict)
    timings: dict[str, float] = field(default_factory=dict)
    left_out: list[dict[str, Any]] = field(default_factory=list)
    # Block -> names of the parameters that rest on their prior alone: photo and landmarks say nothing of them.
    unobserved: dict[str, list[str]] = field(default_factory=dict)
    # What the normal equations leave open: "count" of "of" directions, "by_block", and "sentences" that name them.
    null_directions: dict[str, Any] = field(default_factory=dict)
    # What the fit took from the photo's file, in words: its "size" and "color" space, and where "focal" comes from.
    photo: dict[str, str] = field(default_factory=dict)
    # The face model's "name", "license" and "source"; none in results of an older version.
    model_origin: dict[str, str] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    seed: int = 0
    arrays: dict[str, np.ndarray] = field(default_factory=dict)
    folder: Path | None = None

    @property
    def model_to_stage(self) -> np.ndarray:
        """(4, 4), the head pose in the stage."""
        return self.camera_to_stage @ self.model_to_camera

    def write_into(self, folder: Path) -> None:
        """Write result.json and result.npz into an existing folder."""
        data = {
            "schema": SCHEMA_VERSION, "status": self.status, "advice": self.advice, "model": self.model,
            "camera": self.camera.to_json(), "seed": self.seed, "roughness": self.roughness,
            "identity": dict(zip(self.identity_names, self.identity.tolist(), strict=True)),
            "expression": dict(zip(self.expression_names, self.expression.tolist(), strict=True)),
            "pose": {"model_to_camera": self.model_to_camera, "camera_to_stage": self.camera_to_stage},
            "lights": [
                {"position": p, "direction": d, "side": s, "radiance": r, "state": int(state)}
                for p, d, s, r, state in zip(
                    self.stage.position, self.stage.direction, self.stage.side,
                    self.stage.radiance, self.stage.state, strict=True,
                )
            ],
            "energy": self.energy, "errors": self.errors, "timings": self.timings,
            "left_out": self.left_out, "unobserved": self.unobserved,
            "null_directions": self.null_directions, "photo": self.photo, "model_origin": self.model_origin,
            "versions": self.versions,
        }  # fmt: skip
        write_json(folder / "result.json", data)
        arrays: dict[str, np.ndarray] = {
            "vertices": self.vertices.astype(np.float32), "triangles": self.triangles.astype(np.int32),
            "identity": self.identity, "expression": self.expression, "albedo": self.albedo,
            "specular": self.specular, "roughness": np.array(self.roughness),
            "model_to_camera": self.model_to_camera, "camera_to_stage": self.camera_to_stage,
        }  # fmt: skip
        arrays |= {f"stage/{name}": getattr(self.stage, name) for name in LIGHT_ARRAYS}
        arrays |= {f"extra/{name}": value for name, value in self.arrays.items()}
        write_arrays(folder / "result.npz", arrays)

    @classmethod
    def load(cls, folder: Path) -> Result:
        """Read a result folder. Raises InputError when a file is missing or of another version."""
        return read_consistently(Path(folder), cls._read)

    @classmethod
    def _read(cls, folder: Path) -> Result:
        if not folder.is_dir():
            raise InputError(f"The result folder '{folder}' does not exist; run a fit first.")
        data = read_json(folder / "result.json", "result file")
        if data.get("schema") != SCHEMA_VERSION:
            raise InputError(f"The result '{folder}' has schema {data.get('schema')}, expected {SCHEMA_VERSION}.")
        arrays = read_arrays(folder / "result.npz", "result's arrays")
        try:
            return cls(
                status=data["status"], advice=data["advice"], model=data["model"],
                camera=Camera.from_json(data["camera"]),
                camera_to_stage=arrays["camera_to_stage"], model_to_camera=arrays["model_to_camera"],
                identity=arrays["identity"], expression=arrays["expression"], albedo=arrays["albedo"],
                specular=arrays["specular"], roughness=float(arrays["roughness"]),
                stage=LightStage(**{name: arrays[f"stage/{name}"] for name in LIGHT_ARRAYS}),
                vertices=arrays["vertices"], triangles=arrays["triangles"],
                identity_names=tuple(data["identity"]), expression_names=tuple(data["expression"]),
                energy=data["energy"], errors=data["errors"], timings=data["timings"],
                left_out=data["left_out"], unobserved=data.get("unobserved", {}),
                null_directions=data.get("null_directions", {}),
                photo=data.get("photo", {}),
                model_origin=data.get("model_origin", {}), versions=data["versions"], seed=data["seed"],
                arrays={name[6:]: array for name, array in arrays.items() if name.startswith("extra/")},
                folder=folder,
            )  # fmt: skip
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"The result '{folder}' is incomplete or damaged ({error}); run the fit again.") from error
