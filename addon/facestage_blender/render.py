"""Pictures of the scene from Cycles, as linear pixels, and pictures on disk."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from .material import image_pixels

BOUNCES = ("max_bounces", "diffuse_bounces", "glossy_bounces", "transmission_bounces", "volume_bounces")


def render_linear(scene: bpy.types.Scene, samples: int, direct_only: bool = False, seed: int = 0) -> np.ndarray:
    """(h, w, 4) float32 linear RGB and coverage of the camera's view, background left out.

    ``direct_only`` leaves out light that was reflected more than once, as the fit does.
    """
    values: list[tuple[Any, str, Any]] = [
        (scene.render, "engine", "CYCLES"),
        (scene.render, "film_transparent", True),
        (scene.render, "use_compositing", False),
        (scene.render, "use_sequencer", False),
        (scene.render.image_settings, "file_format", "OPEN_EXR"),
        (scene.render.image_settings, "color_mode", "RGBA"),
        (scene.render.image_settings, "color_depth", "32"),
        (scene.cycles, "device", "CPU"),
        (scene.cycles, "samples", samples),
        (scene.cycles, "seed", seed),
        (scene.cycles, "use_denoising", False),
        (scene.cycles, "use_adaptive_sampling", False),
        (scene.cycles, "sample_clamp_indirect", 0.0),
        (scene.cycles, "pixel_filter_type", "BOX" if direct_only else "BLACKMAN_HARRIS"),
    ]
    values += [(scene.cycles, name, 0 if direct_only else 4) for name in BOUNCES]
    with (
        tempfile.TemporaryDirectory() as folder,
        _temporarily([*values, (scene.render, "filepath", f"{folder}/render.exr")]),
    ):
        bpy.ops.render.render(write_still=True, scene=scene.name)
        return read_pixels(Path(folder) / "render.exr")


def read_pixels(path: Path) -> np.ndarray:
    """(h, w, 4) float32 pixels of a picture file as stored, row 0 at the top."""
    image = bpy.data.images.load(str(path))
    try:
        image.colorspace_settings.name = "Non-Color"
        image.alpha_mode = "CHANNEL_PACKED"
        return image_pixels(image).copy()
    finally:
        bpy.data.images.remove(image)


def save_png(path: Path, pixels: np.ndarray) -> None:
    """Write sRGB-encoded pixels (h, w, 3) in 0..1 as an 8-bit PNG."""
    _save(path, pixels, "PNG", is_float=False)


def save_exr(path: Path, pixels: np.ndarray) -> None:
    """Write linear pixels (h, w, 3) as a float EXR."""
    _save(path, pixels, "OPEN_EXR", is_float=True)


def srgb(linear: np.ndarray) -> np.ndarray:
    """SRGB encoding of linear values, clipped to 0..1."""
    linear = np.clip(np.nan_to_num(linear), 0.0, 1.0)
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def linear(encoded: np.ndarray) -> np.ndarray:
    """Linear values of sRGB-encoded ones."""
    return np.where(encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0) + 0.055) / 1.055) ** 2.4)


def _save(path: Path, pixels: np.ndarray, file_format: str, is_float: bool) -> None:
    height, width = pixels.shape[:2]
    image = bpy.data.images.new("Facestage picture", width, height, alpha=False, float_buffer=is_float, is_data=True)
    try:
        rgba = np.ones((height, width, 4), np.float32)
        rgba[..., :3] = pixels[::-1, :, :3]
        image.pixels.foreach_set(rgba.ravel())
        image.filepath_raw, image.file_format = str(path), file_format
        image.save()
    finally:
        bpy.data.images.remove(image)


@contextmanager
def _temporarily(values: list[tuple[Any, str, Any]]) -> Iterator[None]:
    """Set attributes for the block, then put back what was there."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in values]
    try:
        for owner, name, value in values:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)
