"""The photograph as a stage of the fit compares itself with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Photo:
    """The photograph at the resolution of a stage."""

    color: np.ndarray  # (h, w, 3) linear
    usable: np.ndarray  # (h, w) bool: finite, not masked out
    skin: np.ndarray  # (h, w) 0..1, how much the color is the face's own
    clipped: np.ndarray  # (h, w, 3) bool: "at least this bright"
