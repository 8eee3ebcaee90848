"""How whole faces vary: what goes with a mode in people.

The identity modes were made each by itself. In ICT-FaceKit's people (neutral.py names the source)
the built-in head's modes vary nearly as they do here, but for two directions, whose standard
deviations are 3.8 and 3.2 times as large: from low, broad noses with full lips to high, narrow ones
with thin lips; and from flat faces that are wide at the cheekbones to narrow ones that stand out
along the middle. Two smooth modes, which are named after nothing that is measured, therefore
carry the others along. tools/derive_variation.py found the weights.
"""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float

# Of the mode, by how many standard deviations others come with one of it.
TOGETHER = {
    "smooth_depth_02": {
        "smooth_depth_02": 1.9,
        "smooth_depth_08": 1.2,
        "smooth_breadth_03": -1.1,
        "head_breadth": 0.9,
        "smooth_depth_01": -0.9,
        "smooth_depth_07": 0.9,
        "lip_thickness_lower": -0.9,
        "smooth_breadth_01": -0.8,
        "lip_thickness_upper": -0.8,
        "nose_breadth": -0.6,
        "smooth_height_06": -0.5,
        "smooth_breadth_02": 0.5,
        "bizygomatic_breadth": 0.5,
        "smooth_height_01": 0.5,
        "smooth_depth_05": 0.5,
        "smooth_height_05": 0.5,
        "nose_protrusion": 0.4,
        "face_taper": -0.4,
        "forehead_slope": -0.4,
        "nose_bridge_height": 0.4,
        "chin_projection": 0.4,
        "eye_depth": -0.4,
        "mouth_width": -0.4,
        "midface_projection": 0.3,
        "mentolabial_depth": -0.3,
        "jaw_angle_height": -0.3,
        "submental_fullness": -0.3,
    },
    "smooth_depth_04": {
        "smooth_depth_04": 1.5,
        "smooth_breadth_02": -1.1,
        "smooth_depth_03": -0.8,
        "smooth_depth_05": 0.7,
        "nose_bridge_height": 0.7,
        "submental_fullness": 0.6,
        "mouth_width": 0.6,
        "brow_ridge": 0.5,
        "smooth_height_04": -0.5,
        "smooth_breadth_01": -0.5,
        "smooth_depth_08": 0.5,
        "nose_protrusion": 0.5,
        "smooth_height_05": -0.5,
        "jaw_angle_height": 0.5,
        "smooth_depth_07": 0.4,
        "bizygomatic_breadth": -0.4,
        "lip_protrusion": -0.4,
        "smooth_breadth_03": -0.4,
        "mentolabial_depth": 0.4,
        "cheekbone_prominence": -0.4,
        "forehead_height": 0.4,
        "nasolabial_fold": -0.4,
        "smooth_height_03": -0.3,
        "nose_dorsum_hump": 0.3,
        "face_height": -0.3,
        "chin_height": 0.3,
        "upper_lip_height": 0.3,
        "nose_root_breadth": 0.3,
        "smooth_depth_02": -0.3,
        "chin_width": 0.3,
        "mouth_height": 0.3,
        "nose_tip_breadth": 0.3,
    },
}


def mixing(names: tuple[str, ...]) -> Float[np.ndarray, "modes modes"]:
    """Each mode as a sum of the independent ones, in the order of ``names``."""
    result = np.eye(len(names))
    for row, name in zip(result, names, strict=True):
        for other, weight in TOGETHER.get(name, {}).items():
            row[names.index(other)] = weight
    return result
