"""The synthetic scene as files: what the command line takes."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.files.color import linear_to_srgb
from facestage.contract.job import Job
from facestage.contract.landmarks import Landmarks
from facestage.contract.light_stage import fibonacci_stage
from reference.synthetic_scene import Scene


@dataclass(frozen=True)
class Case:
    """Paths of a photo and what belongs to it."""

    photo: Path
    landmarks: Path
    camera: Path
    model: Path
    truth: Path

    @property
    def model_option(self) -> str:
        return f"npz:{self.model}"

    def job(self, lights: int = 4, **changes: Any) -> Job:
        """A fit of the photo on the CPU; ``changes`` are fields of the job."""
        job = Job(
            self.photo,
            self.model_option,
            Landmarks.read(self.landmarks),
            Camera.read(self.camera),
            stage=fibonacci_stage(lights),
            device="cpu",
            truth=self.truth,
        )
        return replace(job, **changes)


def upper_third(seen: np.ndarray) -> np.ndarray:
    """Of a face that is ``seen`` (h, w) bool, the pixels of its upper third."""
    rows = np.flatnonzero(seen.any(axis=1))
    below = np.arange(len(seen)) > rows[0] + (rows[-1] - rows[0]) / 3
    return seen & ~below[:, None]


def write_case(folder: Path, scene: Scene, noise_px: float = 0.4, shadow: float = 1.0) -> Case:
    """Photo as 8-bit PNG, noisy landmarks, camera, model and truth.

    ``shadow``: how bright something leaves the upper third of the face.
    """
    from PIL import Image

    case = Case(
        *(
            folder / name
            for name in ("photo.png", "landmarks.json", "camera.json", "model.npz", "truth.npz")
        )
    )
    color, seen = scene.render(samples=64)
    color = 0.75 * color / color.max()
    color = np.where(upper_third(seen)[..., None], shadow * color, color)
    Image.fromarray(np.round(255 * linear_to_srgb(color)).astype(np.uint8)).save(case.photo)
    case.landmarks.write_text(json.dumps(scene.landmarks(noise_px=noise_px, seed=1).to_json()))
    case.camera.write_text(json.dumps(scene.state.camera.to_json()))
    scene.model.save(case.model)
    np.savez(case.truth, vertices=scene.forward.pose(scene.state)[1].astype(np.float32))
    return case
