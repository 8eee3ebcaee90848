"""Published means and standard deviations of adult heads, and how they are measured on the model.

Zhuang and Bradtmiller 2005, "Head-and-face anthropometric survey of U.S. respirator users", J.
Occup. Environ. Hyg. 2(11), averaged over men and women; ear, upper lip and eye opening after Farkas
1994, "Anthropometry of the Head and Face". All in mm. Which of them were checked against a second
source, and how they came out, is in docs/face-models.md.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Measurement:
    """A published distribution in mm."""

    mean: float
    sd: float


MEASUREMENTS = {
    "head_length": Measurement(192.4, 7.3),
    "head_breadth": Measurement(149.9, 5.8),
    "minimum_frontal_breadth": Measurement(104.2, 5.6),
    "bizygomatic_breadth": Measurement(139.3, 6.7),
    "bigonial_breadth": Measurement(115.3, 9.7),
    "menton_sellion_length": Measurement(118.1, 6.6),
    "subnasale_sellion_length": Measurement(50.1, 4.0),
    "interpupillary_distance": Measurement(63.2, 3.6),
    "nose_breadth": Measurement(34.9, 4.0),
    "nose_protrusion": Measurement(20.5, 2.7),
    "nasal_root_breadth": Measurement(16.5, 2.2),
    "lip_length": Measurement(49.6, 4.1),
    "eye_fissure_length": Measurement(31.0, 1.4),
    "ear_length": Measurement(61.0, 4.0),
    "upper_lip_height": Measurement(21.2, 2.3),
}
