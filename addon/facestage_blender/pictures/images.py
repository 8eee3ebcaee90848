"""Images of the .blend as arrays: read from a file, made from pixels, read back."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.paths import is_file

LINEAR, DATA = "Linear Rec.709", "Non-Color"


def texture_image(name: str, pixels: np.ndarray) -> bpy.types.Image:
    """A packed float image of a texture, row 0 at v = 1: of linear colors (h, w, 3), or of values
    (h, w).
    """
    height, width = pixels.shape[:2]
    image = bpy.data.images.new(name, width, height, alpha=False, float_buffer=True, is_data=True)
    set_color_space(image, colored=pixels.ndim == 3)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pixels[::-1] if pixels.ndim == 3 else pixels[::-1, :, None]
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    image.pack()
    return image


def set_color_space(image: bpy.types.Image, colored: bool) -> None:
    """Say what the numbers of an image are: linear colors, which Blender shows with the screen's
    tone curve and shades with as they are, or values that are no color.
    """
    image.colorspace_settings.name = LINEAR if colored else DATA


def image_pixels(image: bpy.types.Image) -> np.ndarray:
    """(h, w, 4) float32 pixels of an image, row 0 at the top."""
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(height, width, 4)[::-1]


def load_image(path: Path) -> bpy.types.Image:
    """The image in a file. Raises InputError when it is missing or holds no picture."""
    if not is_file(path):
        raise InputError(f"The photo '{path}' does not exist; check the path.")
    try:
        image = bpy.data.images.load(str(path), check_existing=True)
    except RuntimeError as error:
        raise InputError(
            f"The photo '{path}' cannot be read; expected a PNG, JPEG or EXR picture."
        ) from error
    if not (image.size[0] and image.size[1]):
        if not image.users:
            bpy.data.images.remove(image)
        raise InputError(
            f"The photo '{path}' holds no picture; expected a PNG, JPEG or EXR picture."
        )
    return image
