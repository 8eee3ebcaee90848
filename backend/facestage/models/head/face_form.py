"""The form of people's faces, finer than identity modes can say it: dorsum, tip and wings of the
nose, nostrils, sockets of the eyes, lips and the skin around them.

The head was modelled by hand, and its neutral face (neutral.py) is a sum of smooth modes: a narrow
ridge for a nose, a straight shelf for brows. These moves lay it on the mean face of ICT-FaceKit
(MIT licence, (c) University of Southern California; Li et al. 2020, "Learning Formation of
Physically-Based Face Attributes") wherever the front of the face is skin. Lids keep their form and
follow the eyeballs, teeth and tongue follow the lips, outlines, ears, skull and neck stay.
tools/derive_face_form.py found them.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.face_model import FaceModel
from facestage.contract.files.storage import read_arrays

DATA = Path(__file__).parent / "data" / "face_form.npz"


def face_form(count: int) -> Float[np.ndarray, "vertices 3"]:
    """What is added to the ``count`` vertices of the neutral face, in mm; a mirror image of
    itself.
    """
    arrays = read_arrays(DATA, "form of the face")
    moves = np.zeros((count, 3))
    moves[arrays["vertex"]] = arrays["move"]
    return moves


def without_form(head: FaceModel) -> FaceModel:
    """The built-in ``head`` as its modes say it, from which the form is derived."""
    form = face_form(len(head.vertices)) * 1e-3
    return replace(head, vertices=(head.vertices - form).astype(np.float32))
