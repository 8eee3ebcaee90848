"""Which photos are compared with each other."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from facestage.fit.stages.matching import ANGLE_MAX, PARTNERS_MAX, partners


def heads(*degrees: float) -> list[np.ndarray]:
    return [Rotation.from_euler("y", angle, degrees=True).as_matrix() for angle in degrees]


def test_few_photos_are_all_compared():
    assert partners(heads(15, -25, 5)) == [(0, 1), (0, 2), (1, 2)]
    assert len(partners(heads(0, 20, -20, 40))) == 6


def test_profiles_of_two_sides_are_not():
    assert partners(heads(-60, 60)) == []
    assert partners(heads(-60, 0, 60)) == [(0, 1), (1, 2)]


def test_of_many_each_has_those_that_tell_most():
    angles = np.linspace(-35, 35, 8)
    found = partners(heads(*angles))
    count = np.bincount(np.ravel(found), minlength=8)
    assert count.min() >= PARTNERS_MAX and len(found) < 8 * 7 / 2
    # Two photos from one side differ by too little.
    assert (0, 1) not in found and (0, 3) in found
    assert all(abs(angles[a] - angles[b]) <= ANGLE_MAX for a, b in found)
