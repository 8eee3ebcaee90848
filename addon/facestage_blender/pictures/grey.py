"""What something grey in the photo shows of the light's color."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from facestage.contract.files.color import srgb_to_linear
from facestage.contract.grey import CLIP_LEVEL, color_of_grey

from .images import image_pixels, load_image


def read_grey(photo: Path, x: float, y: float) -> np.ndarray:
    """(3,) linear color, its largest channel 1, around pixel (``x``, ``y``) of the file ``photo``,
    from its upper left corner.

    Raises InputError where the photo is saturated, black or transparent there.
    """
    image = load_image(photo)
    pixels = image_pixels(image)
    # Blender leaves the codes of 8 bits as they are; 16 bits it decodes.
    color = pixels[..., :3] if image.is_float else srgb_to_linear(pixels[..., :3])
    full = srgb_to_linear(np.full(3, CLIP_LEVEL))
    if image.file_format == "OPEN_EXR":
        full = np.full(3, np.inf)
    usable = np.isfinite(color).all(axis=2) & (pixels[..., 3] > 0)
    found = color_of_grey(color, usable, color >= full, x, y)
    return found / found.max()
