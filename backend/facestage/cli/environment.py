"""Maps of the surroundings as options name them: FILE.exr, perhaps with @DEGREES behind it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

from facestage.contract.errors import InputError

if TYPE_CHECKING:
    import numpy as np


def read_environment(said: str) -> tuple[np.ndarray, float]:
    """The map (h, w, 3), linear, and the degrees that it is turned by about the vertical.

    Raises InputError.
    """
    from facestage.images.image_io import read_exr

    given, mark, text = said.rpartition("@")
    given, text = (given, text) if mark else (text, "0")
    try:
        degrees = float(text)
    except ValueError:
        degrees = math.nan
    if not math.isfinite(degrees):
        raise InputError(
            f"The surroundings '{said}' are turned by '{text}', expected degrees, as in sky.exr@40."
        )
    if Path(given).suffix.lower() != ".exr":
        raise InputError(
            f"The surroundings '{given}' are no .exr file; save them as OpenEXR (ZIP)."
        )
    return read_exr(Path(given)), degrees
