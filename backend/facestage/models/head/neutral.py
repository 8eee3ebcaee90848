"""Where the middle of all people lies: the neutral face as a sum of named identity modes on top of
the head that was modelled by hand.

Published breadths and heights leave open how a face is curved: how far chin, lips and nose lie
before the cheeks, how high the jaw's angle sits, how steep the forehead is. The modelled head was
too pointed there and its forehead too steep. These weights bring it, along its normals, to the mean
face of ICT-FaceKit (MIT licence, (c) University of Southern California; Li et al. 2020, "Learning
Formation of Physically-Based Face Attributes"), as far as a prior of one standard deviation for
each mode and the published means (anthropometry.py) let them; tools/derive_neutral.py found them.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float

# Standard deviations of the independent modes, which are what they were.
NEUTRAL = {
    "forehead_slope": 2.1,
    "chin_projection": -1.7,
    "smooth_height_03": -1.6,
    "smooth_breadth_03": 1.4,
    "smooth_height_04": -1.3,
    "smooth_depth_02": -1.2,
    "midface_projection": -1.1,
    "chin_width": -1.0,
    "smooth_depth_03": 1.0,
    "cheekbone_prominence": -1.0,
    "smooth_depth_06": -1.0,
    "lip_protrusion": 0.8,
    "smooth_height_02": -0.8,
    "jaw_angle_width": 0.8,
    "smooth_depth_05": 0.7,
    "face_height": -0.7,
    "bizygomatic_breadth": -0.7,
    "smooth_depth_04": -0.7,
    "smooth_depth_08": 0.7,
    "smooth_depth_07": 0.6,
    "eye_spacing": 0.6,
    "brow_ridge": 0.6,
    "nose_tip_breadth": 0.6,
    "smooth_depth_01": -0.6,
    "smooth_breadth_02": 0.5,
    "smooth_height_01": 0.4,
    "minimum_frontal_breadth": 0.4,
    "jaw_angle_height": -0.4,
    "smooth_height_06": -0.3,
    "nose_breadth": -0.3,
    "face_taper": 0.3,
    "submental_fullness": 0.3,
}


def neutral_shift(
    names: tuple[str, ...], modes: Float[np.ndarray, "identities vertices 3"]
) -> Float[np.ndarray, "vertices 3"]:
    """What the weights add to the modelled head, in the modes' unit."""
    weights = np.array([NEUTRAL.get(name, 0.0) for name in names])
    return np.tensordot(weights, modes, 1)
