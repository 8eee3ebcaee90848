"""Pictures of the scene from Cycles, as linear pixels, and pictures on disk."""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from facestage.contract.files.color import linear_to_srgb

from .images import image_pixels

BOUNCES = (
    "max_bounces",
    "diffuse_bounces",
    "glossy_bounces",
    "transmission_bounces",
    "volume_bounces",
)


@dataclass(frozen=True)
class Crop:
    """A part of the camera's view, ``box`` = (left, top, right, bottom) in pixels, enlarged
    ``scale`` times.
    """

    box: tuple[int, int, int, int]
    scale: int = 1

    @property
    def size(self) -> tuple[int, int]:
        """Height and width in rendered pixels."""
        left, top, right, bottom = self.box
        return self.scale * (bottom - top), self.scale * (right - left)

    def settings(self, render: Any) -> list[tuple[Any, str, Any]]:
        """The render settings that show this part."""
        left, top, right, bottom = self.box
        width, height = render.resolution_x, render.resolution_y
        return [
            (render, "use_border", True),
            (render, "use_crop_to_border", True),
            (render, "border_min_x", left / width),
            (render, "border_max_x", right / width),
            (render, "border_min_y", 1 - bottom / height),
            (render, "border_max_y", 1 - top / height),
            (render, "resolution_percentage", 100 * self.scale),
        ]


def render_linear(
    scene: bpy.types.Scene,
    samples: int,
    direct_only: bool = False,
    seed: int = 0,
    crop: Crop | None = None,
    denoise: bool = False,
    background: bool = False,
) -> np.ndarray:
    """(h, w, 4) float32 linear RGB and coverage of the camera's view, without the ``background``
    unless it is asked for.

    ``direct_only`` leaves out light that was reflected more than once, as the fit does.
    """
    values: list[tuple[Any, str, Any]] = [
        (scene.render, "engine", "CYCLES"),
        (scene.render, "film_transparent", not background),
        (scene.render, "use_compositing", False),
        (scene.render, "use_sequencer", False),
        (scene.render.image_settings, "file_format", "OPEN_EXR"),
        (scene.render.image_settings, "color_mode", "RGBA"),
        (scene.render.image_settings, "color_depth", "32"),
        (scene.cycles, "device", "CPU"),
        (scene.cycles, "samples", samples),
        (scene.cycles, "seed", seed),
        (scene.cycles, "use_denoising", denoise),
        (scene.cycles, "use_adaptive_sampling", False),
        (scene.cycles, "sample_clamp_indirect", 0.0),
        (scene.cycles, "pixel_filter_type", "BOX" if direct_only else "BLACKMAN_HARRIS"),
    ]
    values += [(scene.cycles, name, 0 if direct_only else 4) for name in BOUNCES]
    if crop is not None:
        values += crop.settings(scene.render)
    with (
        tempfile.TemporaryDirectory() as folder,
        temporarily([*values, (scene.render, "filepath", f"{folder}/render.exr")]),
        quiet(),
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
    """Write sRGB-encoded pixels (h, w, 3), or with straight alpha (h, w, 4), in 0..1 as an 8-bit
    PNG.
    """
    _save(path, pixels, "PNG", is_float=False)


def save_exr(path: Path, pixels: np.ndarray) -> None:
    """Write linear pixels (h, w, 3) as a float EXR."""
    _save(path, pixels, "OPEN_EXR", is_float=True)


def srgb(linear: np.ndarray) -> np.ndarray:
    """SRGB encoding of linear values, clipped to 0..1."""
    return linear_to_srgb(np.clip(np.nan_to_num(linear), 0.0, 1.0))


def save_jpeg(path: Path, pixels: np.ndarray, quality: int) -> None:
    """Write sRGB-encoded pixels (h, w, 3) in 0..1 as a JPEG of a quality from 1 to 100."""
    _save(path, pixels, "JPEG", is_float=False, quality=quality)


def _save(
    path: Path, pixels: np.ndarray, file_format: str, is_float: bool, quality: int = 0
) -> None:
    height, width = pixels.shape[:2]
    alpha = pixels.shape[2] == 4
    image = bpy.data.images.new(
        "Facestage picture", width, height, alpha=alpha, float_buffer=is_float, is_data=True
    )
    try:
        rgba = np.ones((height, width, 4), np.float32)
        rgba[..., : pixels.shape[2]] = pixels[::-1]
        image.pixels.foreach_set(rgba.ravel())
        image.filepath_raw, image.file_format = str(path), file_format
        image.save(quality=quality)
    finally:
        bpy.data.images.remove(image)


@contextmanager
def quiet() -> Iterator[None]:
    """Without a window Blender prints a line for every picture; keep them out of the command line's
    output.
    """
    if not bpy.app.background:
        yield
        return
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        with Path(os.devnull).open("w", encoding="utf-8") as nothing:
            os.dup2(nothing.fileno(), 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


@contextmanager
def temporarily(values: list[tuple[Any, str, Any]]) -> Iterator[None]:
    """Set attributes for the block, then put back what was there."""
    before = [(owner, name, getattr(owner, name)) for owner, name, _ in values]
    try:
        for owner, name, value in values:
            setattr(owner, name, value)
        yield
    finally:
        for owner, name, value in before:
            setattr(owner, name, value)
