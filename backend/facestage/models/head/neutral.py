"""Where the middle of all people lies: the neutral face as a sum of named identity modes on top of
the head that was modelled by hand.

Published breadths and heights leave open how a face is curved: how far chin, lips and nose lie
before the cheeks, how high the jaw's angle sits. The modelled head was too pointed there. These
weights bring it, along its normals, to the mean face of ICT-FaceKit (MIT licence, (c) University of
Southern California; Li et al. 2020, "Learning Formation of Physically-Based Face Attributes") from
the brows down, as far as a prior of one standard deviation for each mode and the published means
(anthropometry.py) let them; tools/derive_neutral.py found them.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float

# Standard deviations of the mode. The modes themselves are what they were.
NEUTRAL = {
    "chin_projection": -1.4,
    "midface_projection": -0.8,
    "chin_width": -0.7,
    "jaw_angle_width": 0.7,
    "brow_height": -0.7,
    "face_taper": 0.6,
    "face_height": -0.6,
    "cheekbone_prominence": -0.5,
    "nose_root_breadth": 0.5,
    "jaw_angle_height": -0.5,
    "eye_depth": 0.5,
    "bizygomatic_breadth": -0.5,
    "face_flatness": 0.5,
    "nose_breadth": -0.5,
    "lip_protrusion": 0.4,
    "cheek_fullness": 0.4,
    "nose_length": -0.3,
    "nose_protrusion": 0.3,
    "eye_height": -0.3,
    "nose_tip_breadth": 0.3,
    "nose_tip_height": 0.3,
}


def neutral_shift(
    names: tuple[str, ...], modes: Float[np.ndarray, "identities vertices 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """What the weights add to the modelled head, in the modes' unit."""
    weights = np.array([NEUTRAL.get(name, 0.0) for name in names])
    return np.tensordot(weights, modes, 1)
