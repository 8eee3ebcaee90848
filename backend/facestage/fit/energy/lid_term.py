"""The lid term: how far the lids are apart, which landmarks know better than where each lid is.

Points of both lids err together with the whole face; their distance does not. On pictures of known
faces it is off by a fortieth of the eye's width, when every point by itself passes for a tenth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np

from facestage.contract.landmarks import Landmarks
from facestage.fit.energy.pair_distances import SeenPairs, pairs_on
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.given.lids import seen_lids, shutters

# How far the distance of two points is off, as a share of the eye's width.
SIGMA_SHARE = 0.025
# Shares of the width that shut lids are nearer than the expression that shuts the mean face brings
# them: others' lids must leave no slit.
PRESSED = 0.01
# Of an eye's pairs, how many err independently.
INDEPENDENT = 1.75


@dataclass(frozen=True, eq=False)
class LidTerm(SeenPairs):
    """The distances of the lids across the eyes: an eye that begins open may be shut."""

    words: ClassVar = {"lids": "Opening of the eyes"}
    name: ClassVar = "lids"

    @classmethod
    def seen(cls, geometry: FaceGeometry, landmarks: Landmarks, weight: float = 1.0) -> Self | None:
        """The lids of the eyes that ``landmarks`` show; None where they show none."""
        pairs, up, apart = [], [], []
        scheme = landmarks.scheme
        for eye, shutter in zip(
            seen_lids(landmarks), shutters(geometry.model, scheme), strict=True
        ):
            if eye is None:
                continue
            # Where the network sees the borders of lids that touch is no matter.
            left = 0.0 if shutter is None else shutter.left - PRESSED
            wanted = (1 - eye.shut) * eye.apart + eye.shut * left
            pairs.append(eye.pairs)
            up.append(np.tile(eye.across / (SIGMA_SHARE * eye.width), (len(eye.pairs), 1)))
            apart.append(wanted / SIGMA_SHARE)
        if not pairs:
            return None
        on_face = pairs_on(geometry, scheme, np.concatenate(pairs))
        share = INDEPENDENT / len(apart[0])
        return cls(on_face, np.concatenate(up), np.concatenate(apart), share, weight)
