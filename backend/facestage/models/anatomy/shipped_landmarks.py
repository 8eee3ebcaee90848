"""Landmark tables that come with Facestage: MediaPipe's 478 points on the meshes that it knows.

The file of a mesh holds ``table`` (478, 6), three vertices and their barycentric weights, and
``positions`` (478, 3), where these points lie on the mean face (metres, model frame); the file of
the scheme itself how far the points are off. tools/derive_landmarks.py and
tools/landmark_scatter.py made them.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from facestage.contract.files.storage import read_arrays

SCHEME = "mediapipe478"
_FOLDER = Path(__file__).parent / "data"


def read_table(name: str) -> tuple[np.ndarray, np.ndarray]:
    """``table`` (478, 6) and ``positions`` (478, 3) of the mesh called ``name``, "ict" or
    "default".
    """
    arrays = read_arrays(_FOLDER / f"{SCHEME}_{name}.npz", "landmark table")
    return arrays["table"], arrays["positions"]


def read_deviations() -> tuple[np.ndarray, float]:
    """Standard deviations (478,) relative to a sharp point's, and how many independent points all
    of them are.
    """
    arrays = read_arrays(_FOLDER / f"{SCHEME}.npz", "landmark deviations")
    return arrays["deviation"], float(arrays["independent"])
