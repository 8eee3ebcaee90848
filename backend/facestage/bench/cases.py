"""Photographs with known truth: folders of the user's, the shared ones, or a synthetic one."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.case_files import CAMERA, LANDMARKS, PHOTO, SCAN, TRUTH
from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file
from facestage.contract.files.storage import write_arrays, write_json
from facestage.contract.job import DEFAULT_MODEL, Job
from facestage.contract.landmarks import Landmarks

ICT_ARCHIVE = "ict-facekit.tar.xz"
SYNTHETIC, SYNTHETIC_SIDE_PX = "synthetic", 192


@dataclass(frozen=True)
class Case:
    """A folder with photo.png, landmarks.json, camera.json and truth.npz, and the model its truth
    belongs to; or one with photo.png, camera.json and scan.npz, whose face is found in the photo
    where it has no landmarks.

    ``face_region``: the file that says which vertices of a scan are its face.
    """

    name: str
    folder: Path
    model: str
    face_region: Path | None = None

    def job(self, device: str = "auto", seed: int = 0) -> Job:
        """The fit of the photo. Raises InputError for what the folder lacks."""
        scanned = is_file(self.folder / SCAN) and not is_file(self.folder / TRUTH)
        for name in (PHOTO, CAMERA) if scanned else (PHOTO, LANDMARKS, CAMERA, TRUTH):
            if not is_file(self.folder / name):
                raise InputError(
                    f"The case '{self.folder}' has no {name}; a case holds {PHOTO}, "
                    f"{LANDMARKS}, {CAMERA} and {TRUTH}, or {PHOTO}, {CAMERA} and {SCAN}."
                )
        landmarks = self.folder / LANDMARKS
        return Job(
            (self.folder / PHOTO).absolute(),
            self.model,
            None if scanned and not is_file(landmarks) else Landmarks.read(landmarks),
            Camera.read(self.folder / CAMERA),
            seed=seed,
            device=device,
            truth=self.folder / (SCAN if scanned else TRUTH),
            face_region=self.face_region if scanned else None,
        )


def find_cases(
    folders: Sequence[Path],
    model: str | None,
    scratch: Path,
    side_px: int = SYNTHETIC_SIDE_PX,
    face_region: Path | None = None,
) -> tuple[list[Case], str]:
    """The cases of a bench, and a sentence that says which they are.

    The given ``folders``; without any, those beside ICT-FaceKit in the data folder; without that, a
    synthetic photo of ``side_px`` pixels along a side that is written into ``scratch``.
    """
    if folders:
        cases = [
            Case(folder.resolve().name, folder, model or DEFAULT_MODEL, face_region)
            for folder in folders
        ]
        return cases, f"Cases as given, fitted with the model {model or DEFAULT_MODEL}."
    data = data_folder()
    shared = [path for path in sorted((data / "cases").glob("*")) if (path / PHOTO).is_file()]
    archive = data / ICT_ARCHIVE
    if shared and (model is not None or archive.exists()):
        chosen = model or f"ict:{archive}"
        words = "ICT-FaceKit" if model is None else f"the model {model}"
        return [
            Case(path.name, path, chosen) for path in shared
        ], f"Cases of the data folder, fitted with {words}."
    return [synthetic_case(scratch / SYNTHETIC, model, side_px)], (
        "No cases were given or found, so the photo is synthetic, rendered by Facestage's own "
        "forward model: it shows speed, not how well a fit stands what the model does not explain. "
        "Give real ones with --case."
    )


def data_folder() -> Path:
    """$FACESTAGE_DATA, or shared/data beside the working copy."""
    override = os.environ.get("FACESTAGE_DATA")
    return Path(override) if override else Path(__file__).resolve().parents[4] / "shared" / "data"


def synthetic_case(
    folder: Path, model: str | None = None, side_px: int = SYNTHETIC_SIDE_PX
) -> Case:
    """A head with random identity and expression under twelve lights, rendered and written as a
    case.
    """
    # The forward model loads the renderer.
    from facestage.models.registry import load_model
    from facestage.stress.scene import plain_scene, project_landmarks, render, write_png

    scene = plain_scene(load_model(model or DEFAULT_MODEL), seed=5, side_px=side_px)
    folder.mkdir(parents=True, exist_ok=True)
    write_png(folder / PHOTO, render(scene))
    write_json(folder / LANDMARKS, project_landmarks(scene, noise_px=0.7).to_json())
    write_json(folder / CAMERA, scene.camera.to_json())
    vertices = (
        scene.model.shape(scene.identity, scene.expression) @ scene.rotation.T + scene.translation
    )
    write_arrays(folder / TRUTH, {"vertices": vertices.astype(np.float32)}, compress=False)
    return Case(SYNTHETIC, folder, model or DEFAULT_MODEL)
