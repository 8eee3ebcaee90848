"""What is known of both eyes' looks before a photo: they go together."""

from __future__ import annotations

import re

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.face_model import FaceModel
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.lids import open_eyes

# By how much one eye's weight may be beyond the other's: a full look is 22 to 30 degrees.
APART_SIGMA = 0.15
_LOOK = re.compile(r"eyeLook(Down|In|Out|Up)_?(L|R)(?:eft|ight)?")
# How far a look goes to the subject's left and up, of either eye.
_TOWARDS = {
    ("Out", "L"): (1, 0),
    ("In", "L"): (-1, 0),
    ("In", "R"): (1, 0),
    ("Out", "R"): (-1, 0),
    ("Up", "L"): (0, 1),
    ("Down", "L"): (0, -1),
    ("Up", "R"): (0, 1),
    ("Down", "R"): (0, -1),
}


def looks_apart(
    model: FaceModel, landmarks: Landmarks
) -> Float[np.ndarray, "ties expressions"] | None:
    """How much further the left eye looks to the left and up than the right one, by the weights of
    ``model``, in standard deviations; None where it does not have all looks of both eyes, or
    ``landmarks`` show no iris: looks are then what is left of the lids.
    """
    if not open_eyes(landmarks):
        return None
    apart = np.zeros((2, len(model.expression_names)))
    found: set[tuple[str, str]] = set()
    for column, name in enumerate(model.expression_names):
        match = _LOOK.fullmatch(name)
        if match is None:
            continue
        look = (match[1], match[2])
        found.add(look)
        left = 1 if match[2] == "L" else -1
        apart[:, column] = [left * each for each in _TOWARDS[look]]
    return apart / APART_SIGMA if found == set(_TOWARDS) else None
