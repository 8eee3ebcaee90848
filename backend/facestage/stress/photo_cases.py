"""Damaged, empty and misleading photos."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.case_files import PHOTO
from facestage.contract.job import Job
from facestage.images.image_io import resize
from facestage.stress.case import DOUBT, REFUSAL, Suite
from facestage.stress.scene import (
    BACKGROUND,
    Scene,
    job_of,
    plain_scene,
    render,
    write_job,
    write_png,
)

suite = Suite()


def _png_job(folder: Path, scene: Scene, photo: np.ndarray, alpha: np.ndarray | None = None) -> Job:
    write_png(folder / PHOTO, photo, alpha)
    return job_of(folder, scene, folder / PHOTO)


@suite.add("half-clipped", "half of the face saturated", worst_mm=1.0)
def half_clipped(folder: Path) -> Job:
    """An 8-bit photo, overexposed."""
    scene = plain_scene()
    photo = render(scene)
    skin = photo[(photo != BACKGROUND).any(axis=2)]
    return _png_job(folder, scene, photo / np.median(skin.max(axis=1)))


@suite.add("almost-black", "an 8-bit photo whose brightest pixel has the code 12", worst_mm=1.2)
def almost_black(folder: Path) -> Job:
    """Quantised to a dozen levels."""
    scene = plain_scene()
    return _png_job(folder, scene, render(scene, background=0.0, exposure=0.0035))


@suite.add("one-pixel", "a photo of 1 x 1 pixels", right=REFUSAL)
def one_pixel(folder: Path) -> Job:
    """Nothing to fit."""
    scene = replace(plain_scene(), camera=Camera.default(1, 1, 2.5))
    return write_job(folder, scene, np.full((1, 1, 3), 0.3))


@suite.add(
    "large-photo",
    "4096 x 4096 pixels, the face on 300 of them",
    worst_mm=0.8,
    worst_psnr=32,
    seconds=600,
)
def large_photo(folder: Path) -> Job:
    """The plain photo four times as large, within a wide background: smooth, because no lamp makes
    highlights of blocks.
    """
    scene, zoom, side, corner = plain_scene(), 4, 4096, np.array([1900, 1200])
    small = render(scene)
    large = resize(small, zoom * small.shape[1], zoom * small.shape[0])
    photo = np.full((side, side, 3), BACKGROUND, np.float32)
    photo[corner[1] : corner[1] + len(large), corner[0] : corner[0] + len(large)] = large
    principal = corner + zoom * np.array(scene.camera.principal_px)
    camera = Camera(
        side, side, zoom * scene.camera.focal_px, (float(principal[0]), float(principal[1]))
    )
    return write_job(folder, replace(scene, camera=camera), photo)


@suite.add(
    "nan-and-infinity",
    "NaN and infinity all over the face, negative pixels beside it",
    worst_mm=0.8,
    worst_psnr=34,
)
def nan_and_infinity(folder: Path) -> Job:
    """What a renderer with a bug writes."""
    scene = plain_scene()
    photo = render(scene)
    damage = np.random.default_rng(3).uniform(size=photo.shape[:2])
    photo[damage < 0.04] = np.nan
    photo[(damage > 0.04) & (damage < 0.06)] = np.inf
    photo[(damage > 0.06) & (damage < 0.08), 1] = -np.inf
    photo[:10, :10] = -1.0
    return write_job(folder, scene, photo)


@suite.add("all-nan", "a photo of NaN alone", right=REFUSAL)
def all_nan(folder: Path) -> Job:
    """No usable pixel."""
    scene = plain_scene()
    return write_job(folder, scene, np.full((scene.camera.height, scene.camera.width, 3), np.nan))


def _even(folder: Path, value: float) -> Job:
    scene = plain_scene()
    return _png_job(folder, scene, np.full((scene.camera.height, scene.camera.width, 3), value))


@suite.add("black-photo", "every pixel 0", right=DOUBT)
def black_photo(folder: Path) -> Job:
    """Darkness explains it perfectly, which says nothing about the face."""
    return _even(folder, 0.0)


@suite.add("white-photo", "every pixel saturated", right=DOUBT)
def white_photo(folder: Path) -> Job:
    """Any bright enough light explains it."""
    return _even(folder, 1.0)


@suite.add(
    "noise-photo",
    "random noise where the landmarks say that a face is",
    worst_mm=1.2,
    worst_psnr=22,
)
def noise_photo(folder: Path) -> Job:
    """Nothing to see."""
    scene = plain_scene()
    size = (scene.camera.height, scene.camera.width, 3)
    return write_job(folder, scene, np.random.default_rng(5).uniform(0, 1, size))


@suite.add("twenty-pixels", "an alpha mask that leaves 20 pixels of the face", worst_mm=1.2)
def twenty_pixels(folder: Path) -> Job:
    """Fewer observations than unknowns by far."""
    scene = plain_scene()
    alpha = np.zeros((scene.camera.height, scene.camera.width), bool)
    alpha[54:58, 40:45] = True
    return _png_job(folder, scene, render(scene), alpha)


@suite.add("mask-beside-face", "an alpha mask that leaves only the background", right=REFUSAL)
def mask_beside_face(folder: Path) -> Job:
    """Usable pixels, none of them on the face."""
    scene = plain_scene()
    alpha = np.zeros((scene.camera.height, scene.camera.width), bool)
    alpha[:5, :5] = True
    return _png_job(folder, scene, render(scene), alpha)


@suite.add(
    "skin-background", "a background of exactly the skin's color", worst_mm=0.8, worst_psnr=34
)
def skin_background(folder: Path) -> Job:
    """No edge between face and background."""
    scene = plain_scene()
    photo = render(scene)
    color = np.median(photo[(photo != BACKGROUND).any(axis=2)], axis=0)
    return write_job(folder, scene, render(scene, background=color))


@suite.add(
    "half-occluded", "an even, skin-colored board over the lower half of the face", worst_mm=1.5
)
def half_occluded(folder: Path) -> Job:
    """The color model cannot see it, and its evenness contradicts the shading that a face would
    have.
    """
    scene = plain_scene()
    photo = render(scene)
    photo[62:] = 0.8 * np.median(photo[(photo != BACKGROUND).any(axis=2)], axis=0)
    return write_job(folder, scene, photo)


@suite.add("blue-occluder", "a blue board over the left half of the face", worst_mm=1.2)
def blue_occluder(folder: Path) -> Job:
    """The color model should see it."""
    scene = plain_scene()
    photo = render(scene)
    photo[:, :54] = [0.05, 0.1, 0.6]
    return write_job(folder, scene, photo)


@suite.add("wrong-camera", "a camera for a photo of another size", right=REFUSAL)
def wrong_camera(folder: Path) -> Job:
    """The camera file of another photo."""
    scene = plain_scene()
    job = write_job(folder, scene, render(scene))
    return replace(job, camera=Camera.default(640, 480))


@suite.add("no-time", "a budget of a tenth of a second", worst_mm=1.5, worst_psnr=30)
def no_time(folder: Path) -> Job:
    """The landmark stage is all there is time for."""
    scene = plain_scene()
    return replace(write_job(folder, scene, render(scene)), budget_seconds=0.1)
