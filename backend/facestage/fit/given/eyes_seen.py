"""Which pixels surely show an iris, or the white beside it, as landmarks tell.

A fitted eyeball lies a pixel or two off, and where it has the iris of a narrow eye, half of the
photo's pixels are lid or white. The network finds lids and irises to half a pixel.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.face_areas import opening_share
from facestage.fit.given.lids import open_eyes

# Radii of the iris: between pupil and limbus, and from where on a blurred photo shows only white.
IRIS_INSIDE, WHITE_OUTSIDE = (0.4, 0.85), 1.2
OPEN_MIN = 0.95  # share of a pixel between the lids


@dataclass(frozen=True)
class EyesSeen:
    """Pictures like the photo."""

    iris: Bool[np.ndarray, "height width"]
    white: Bool[np.ndarray, "height width"]
    # how far below the border of the upper lid, in radii of the iris; NaN off the eyes
    below_lid: Float[np.ndarray, "height width"]

    def part(self, name: str) -> Bool[np.ndarray, "height width"] | None:
        """What shows ``iris`` or ``white``; None for what is no part of an eye."""
        return {"iris": self.iris, "white": self.white}.get(name)

    @classmethod
    def of(cls, shape: tuple[int, int], landmarks: Landmarks) -> EyesSeen | None:
        """None for landmarks that know no irises, or only of eyes that are shut or hidden."""
        points = landmarks.points
        iris, white = np.zeros(shape, bool), np.zeros(shape, bool)
        below, opened = np.full(shape, np.nan), None
        for eye, lids in open_eyes(landmarks):
            at = list(eye.iris)
            opened = opening_share(shape, landmarks) > OPEN_MIN if opened is None else opened
            centre = points[at[0]]
            radius = max(float(np.linalg.norm(points[at[1:]] - centre, axis=1).mean()), 1e-6)
            reach = lids.width
            low = np.clip(np.floor(centre - reach), 0, shape[::-1]).astype(int)
            high = np.clip(np.ceil(centre + reach), 0, shape[::-1]).astype(int)
            box = slice(low[1], high[1]), slice(low[0], high[0])
            y, x = np.mgrid[box]
            from_centre = (np.stack([x, y], axis=-1) + 0.5 - centre) / radius
            distance = np.linalg.norm(from_centre, axis=-1)
            inside = opened[box]
            iris[box] |= inside & (distance > IRIS_INSIDE[0]) & (distance < IRIS_INSIDE[1])
            white[box] |= inside & (distance > WHITE_OUTSIDE)
            along = np.array([-lids.across[1], lids.across[0]])
            upper = (points[lids.pairs[:, 0]] - centre) / radius
            order = np.argsort(upper @ along)
            border = np.interp(
                from_centre @ along, (upper @ along)[order], (upper @ lids.across)[order]
            )
            below[box] = np.where(inside, border - from_centre @ lids.across, below[box])
        return None if opened is None else cls(iris, white, below)
