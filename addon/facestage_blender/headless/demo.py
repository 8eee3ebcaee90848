"""What `make demo` runs: a real photo and a synthetic one, the whole way from pixels to a
relightable .blend.

python -P -m facestage_blender.demo [--out out/demo]
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.case_files import CAMERA, LANDMARKS, PHOTO, TRUTH
from facestage.contract.errors import InputError
from facestage.contract.job import DEFAULT_MODEL
from facestage.contract.landmarks import Landmarks
from facestage.contract.result import RENDER, Result
from facestage.contract.result_files import REPORT

from .command import exit_code

if TYPE_CHECKING:
    import bpy

    from ..pictures.render import Crop

SHIPPED_LANDMARKS = Path(__file__).parent / "data" / "astronaut_landmarks.json"
SEED = 7
BUDGET_SECONDS = 75.0  # for each fit, so that the demo ends within its four minutes on any machine
SAMPLES = 32
CLOSE_UP_PX = 400
ERRORS = (
    ("rigid_mm", "shape, after rigid alignment", "mm"),
    ("similarity_mm", "shape, after similarity alignment", "mm"),
    ("landmark_stage_similarity_mm", "... of the landmarks alone", "mm"),
    ("psnr", "photo, PSNR in the face", "dB"),
    ("light", "light on the face, relative", ""),
    ("albedo", "albedo, RMS", ""),
)


def main(arguments: list[str] | None = None) -> int:
    """Run the demo; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="facestage_blender.demo", description="Fit two photos and show the results."
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/demo"), help="folder for everything the demo makes"
    )
    parser.add_argument(
        "--samples", type=int, default=SAMPLES, help="samples per pixel of the pictures"
    )
    parser.add_argument(
        "--budget", type=float, default=BUDGET_SECONDS, help="seconds for each of the two fits"
    )
    options = parser.parse_args(arguments)
    return exit_code(lambda: run(options), "cancelled.")


def run(options: argparse.Namespace) -> None:
    """Fit both photos, then say what came of them."""
    started, out = time.monotonic(), options.out.resolve()
    real = fit_astronaut(out, options.samples, options.budget)
    synthetic = fit_synthetic(out, options.samples, options.budget)
    for line in (*real, "", *synthetic, "", f"Done in {time.monotonic() - started:.0f} s."):
        print(line)


def fit_astronaut(out: Path, samples: int, budget: float) -> list[str]:
    """Fit the astronaut's portrait; returns what to tell the user."""
    import skimage.data

    from ..backend.commands import find_backend
    from ..pictures import render
    from ..scene.paths import RESULT_FOLDER
    from . import pipeline

    print(
        "1 of 2: a real photo (NASA's portrait of Eileen Collins, public domain)", file=sys.stderr
    )
    out.mkdir(parents=True, exist_ok=True)
    photo = out / "astronaut.png"
    scene = pipeline.empty_scene()
    render.save_png(photo, skimage.data.astronaut() / 255.0)
    backend = find_backend()
    landmarks, origin = astronaut_landmarks(photo, out / "astronaut_landmarks.json", backend)
    order = pipeline.Order(image=photo, out=out / "astronaut", landmarks=landmarks, budget=budget)
    result = pipeline.fit_photo(scene, order, backend, pipeline.progress_printer())
    crop = head_crop(Landmarks.read(SHIPPED_LANDMARKS), result.camera)
    match = agreement(scene, result, crop, samples)
    sheet = _pictures(scene, result, photo, crop, out / "astronaut", samples)
    close = _close_ups(scene, out / "astronaut", samples)
    return [
        "Real photo",
        f"  Landmarks {origin}.",
        f"  {result.advice}",
        f"  Cycles and the fit's own renderer agree to {match:.1f} dB in the face.",
        f"  pictures  {sheet}",
        f"  close-ups {close}",
        f"  report    {out / 'astronaut' / RESULT_FOLDER / REPORT}",
        f"  scene     {out / 'astronaut' / pipeline.SCENE_FILE}",
    ]


def astronaut_landmarks(photo: Path, out: Path, backend: list[str]) -> tuple[Path, str]:
    """The landmark file of the astronaut's portrait, and where it is from: detected, else the one
    that is shipped.
    """
    from ..backend.commands import detect_command
    from .pipeline import run_backend

    try:
        run_backend(detect_command(backend, photo, out), lambda _event: None)
    except InputError as error:
        print(f"The landmarks that come with the demo are used. {error}", file=sys.stderr)
        return SHIPPED_LANDMARKS, "from the file that comes with the demo"
    return out, f"found in the photo ({len(Landmarks.read(out).points)} points)"


def fit_synthetic(out: Path, samples: int, budget: float) -> list[str]:
    """Photograph a made-up person, fit the photo, and compare with the truth."""
    from ..backend.commands import find_backend
    from ..scene.paths import RESULT_FOLDER
    from ..synthetic.cases.person import random_person
    from ..synthetic.photograph import render_person
    from . import pipeline

    print("2 of 2: a synthetic photo with known truth", file=sys.stderr)
    folder = out / "synthetic"
    folder.mkdir(parents=True, exist_ok=True)
    backend, show = find_backend(), pipeline.progress_printer()
    model = pipeline.face_model(DEFAULT_MODEL, backend, show)
    case = folder / "case"
    render_person(pipeline.empty_scene(), model, random_person(model, SEED), case, seed=SEED)
    scene = pipeline.empty_scene()
    order = pipeline.Order(
        image=case / PHOTO,
        out=folder,
        landmarks=case / LANDMARKS,
        camera=case / CAMERA,
        truth=case / TRUTH,
        budget=budget,
    )
    result = pipeline.fit_photo(scene, order, backend, show)
    crop = head_crop(Landmarks.read(case / LANDMARKS), result.camera)
    sheet = _pictures(scene, result, case / PHOTO, crop, folder, samples)
    rows = [
        f"  {meaning:<36}{result.errors[name]:8.3f} {unit}"
        for name, meaning, unit in ERRORS
        if name in result.errors
    ]
    return [
        "Synthetic photo against its truth",
        *rows,
        f"  pictures  {sheet}",
        f"  report    {folder / RESULT_FOLDER / REPORT}",
        f"  scene     {folder / pipeline.SCENE_FILE}",
    ]


def agreement(scene: bpy.types.Scene, result: Result, crop: Crop, samples: int) -> float:
    """PSNR in dB between Cycles' picture of the written-back scene and the fit's own, in the face;
    with light from skin to skin where the fit has about as much of it as there is.
    """
    from ..pictures.render import read_pixels, render_linear

    if result.folder is None:
        raise InputError("The result is not on disk; run the fit again.")
    theirs = read_pixels(result.folder / RENDER)[..., :3]
    left, top, right, bottom = crop.box
    theirs = theirs[top:bottom, left:right]
    direct = float(result.parameters.get("interreflection", 0.0)) < 0.5
    ours = render_linear(scene, max(samples, 64), direct_only=direct, crop=replace(crop, scale=1))
    face = (ours[..., 3] > 0.999) & (theirs.max(axis=2) > 0)
    difference = np.clip(ours[..., :3], 0, 1)[face] - np.clip(theirs, 0, 1)[face]
    return float(-10 * np.log10(max(1e-12, float((difference**2).mean()))))


def head_crop(landmarks: Landmarks, camera: Camera, side_px: float = 340.0) -> Crop:
    """A square around the head of which the landmarks are the face, to be shown about ``side_px``
    wide.
    """
    from ..pictures.render import Crop

    low, high = landmarks.points.min(axis=0), landmarks.points.max(axis=0)
    centre = 0.5 * (low + high) - [0, 0.12 * (high - low)[1]]
    half = min(0.85 * float((high - low).max()), camera.width / 2, camera.height / 2)
    centre = np.clip(centre, half, np.array([camera.width, camera.height]) - half)
    left, top = np.floor(centre - half).astype(int)
    side = int(2 * half)
    return Crop(
        (int(left), int(top), int(left) + side, int(top) + side), max(1, round(side_px / side))
    )


def _pictures(
    scene: bpy.types.Scene, result: Result, photo: Path, crop: Crop, folder: Path, samples: int
) -> Path:
    """Render the showcase, save each picture and the contact sheet; returns the sheet's path."""
    from ..pictures.render import save_png
    from .contact_sheet import contact_sheet
    from .showcase import showcase

    pictures = showcase(scene, result, photo, crop, samples)
    (folder / "pictures").mkdir(parents=True, exist_ok=True)
    for caption, pixels in pictures.items():
        save_png(folder / "pictures" / f"{caption.replace(' ', '_')}.png", pixels)
    sheet = folder / "contact_sheet.png"
    contact_sheet(pictures, sheet)
    return sheet


def _close_ups(scene: bpy.types.Scene, folder: Path, samples: int) -> Path:
    """The contact sheet of the head from close by and all around, now with lashes,
    brow hair and wet eyes.
    """
    from .additions import add_to_face
    from .close_ups import close_ups
    from .contact_sheet import contact_sheet

    add_to_face(scene, ("lashes", "brow-hair", "wet-eyes"))
    sheet = folder / "close_ups.png"
    contact_sheet(close_ups(scene, CLOSE_UP_PX, samples), sheet, columns=3)
    return sheet
