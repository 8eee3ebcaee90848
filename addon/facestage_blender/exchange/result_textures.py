"""A result's textures as images in the .blend: all of them, sound, or none."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.exr_header import exr_size
from facestage.contract.files.paths import is_file
from facestage.contract.result import TEXTURE_MAX, Result
from facestage.contract.sequence import Sequence
from facestage.contract.texture_maps import BESIDE_MAPS, TEXTURE_MAPS

from ..pictures.images import image_pixels, set_color_space

WRINKLES_LABEL = "Facestage Wrinkles"  # the first words of their images' names
SIDE_MAX = 8192  # pixels; a fit paints 4096 at most


def loading_steps(result: Result) -> Generator[None, None, dict[str, bpy.types.Image]]:
    """The result's maps by name, packed into the .blend, one in each step.

    Raises InputError when one is missing, damaged or not finite; then, or where it is not carried
    through, none is left behind.
    """
    loaded: dict[str, bpy.types.Image] = {}
    try:
        for each in (*TEXTURE_MAPS, *BESIDE_MAPS):
            folder = Path(result.folder or "")
            if each.required or (result.folder is not None and is_file(folder / each.file)):
                name = f"Facestage {each.socket}"
                loaded[each.name] = _load(folder / each.file, name, each.colored)
                yield
    except (InputError, GeneratorExit):
        for image in loaded.values():
            bpy.data.images.remove(image)
        raise
    return loaded


def wrinkle_images(sequence: Sequence) -> dict[str, bpy.types.Image]:
    """The normal maps of a film's wrinkles by their names, packed into the .blend.

    Raises InputError when one is missing, damaged or not finite; then none is left behind.
    """
    loaded: dict[str, bpy.types.Image] = {}
    folder = Path(sequence.folder or "")
    try:
        for each in sequence.wrinkles:
            path, name = folder / each.normal_file, f"{WRINKLES_LABEL} {each.name}"
            loaded[each.name] = _load(path, name, colored=False, again="track the film again")
    except InputError:
        for image in loaded.values():
            bpy.data.images.remove(image)
        raise
    return loaded


def _load(
    path: Path, name: str, colored: bool, again: str = "run the fit again"
) -> bpy.types.Image:
    if not is_file(path):
        raise InputError(f"The result has no '{path}'; {again}.")
    size = exr_size(path, "result's picture", TEXTURE_MAX, SIDE_MAX)
    damaged = InputError(f"The result's picture '{path}' cannot be read; {again}.")
    try:
        image = bpy.data.images.load(str(path))
    except RuntimeError as error:
        raise damaged from error
    try:
        image.name = name
        set_color_space(image, colored)
        image.alpha_mode = "NONE"
        if tuple(image.size) != size:  # 0 x 0 where Blender could not decode it
            raise damaged
        if not np.isfinite(image_pixels(image)).all():
            raise InputError(f"The result's picture '{path}' holds NaN or infinity; {again}.")
        image.pack()
    except (RuntimeError, InputError) as error:
        bpy.data.images.remove(image)
        raise error if isinstance(error, InputError) else damaged from error
    return image
