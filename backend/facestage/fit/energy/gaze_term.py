"""The gaze term: where the irises are between the corners of the eyes.

Points of the irises err with the whole face, and count as little as their neighbors; where an iris
is in its eye the photo knows to a fraction of that. Without it the prior, which draws the looks
towards 0, leaves people who look aside looking half as far.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.pair_distances import SeenPairs, pairs_on
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.given.lids import open_eyes

# How far an iris is off between the corners, as a share of the eye's width, along it and across: on
# pictures of known faces by 0.021 and 0.018 in the median, and now and then by 0.1.
SIGMA_SHARE = 0.04
# The two corners of an eye are two looks at one iris.
INDEPENDENT = 0.5


@dataclass(frozen=True, eq=False)
class GazeTerm(SeenPairs):
    """The distances of the irises from the corners of their eyes, along the eye and across."""

    words: ClassVar = {"gaze": "Gaze"}
    name: ClassVar = "gaze"

    @classmethod
    def seen(cls, geometry: FaceGeometry, landmarks: Landmarks, weight: float = 1.0) -> Self | None:
        """The irises that ``landmarks`` show in open eyes; None where they show none."""
        points, pairs, along, apart = landmarks.points, [], [], []
        for eye, lids in open_eyes(landmarks):
            centre = eye.iris[0]
            sideways = np.array([-lids.across[1], lids.across[0]])
            for corner in eye.corners:
                for axis in (sideways, lids.across):
                    pairs.append((centre, corner))
                    along.append(axis / (SIGMA_SHARE * lids.width))
                    apart.append((points[centre] - points[corner]) @ along[-1])
        if not pairs:
            return None
        on_face = pairs_on(geometry, landmarks.scheme, np.array(pairs))
        return cls(on_face, np.array(along), np.array(apart), INDEPENDENT, weight)
