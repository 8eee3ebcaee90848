"""Maps of the surroundings as options name them: FILE.exr, perhaps with @DEGREES behind it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from facestage.contract.environment import split_turn
from facestage.contract.errors import InputError

if TYPE_CHECKING:
    import numpy as np


def read_environment(said: str) -> tuple[np.ndarray, float]:
    """The map (h, w, 3), linear, and the degrees that it is turned by about the vertical.

    Raises InputError.
    """
    from facestage.images.image_io import read_exr

    given, degrees = split_turn(said)
    if Path(given).suffix.lower() != ".exr":
        raise InputError(
            f"The surroundings '{given}' are no .exr file; save them as OpenEXR (ZIP)."
        )
    return read_exr(Path(given), "map of the surroundings"), degrees
