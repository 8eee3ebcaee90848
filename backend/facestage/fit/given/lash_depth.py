"""How dark a photo shows the line of the lashes along the upper lids."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates

from facestage.contract.arrays import Float
from facestage.contract.files.color import REC709
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.lids import seen_lids

# In shares of the eye's width, above the landmarks of the upper lid: where the line lies, and the
# skin of the lid that it is compared with.
LINE, LID = (0.0, 0.05), (0.08, 0.14)
SAMPLES = 6
WIDTH_MIN = 10.0  # pixels of an eye, below which its lashes are not seen
# Of the logarithm: the shade of any lid's border, which is no lash, and the darkest line.
SHADE, DARKEST = 0.25, 1.4
DARK = 1e-3  # luminance, as a share of the photo's brightest, below which it counts as this


def lash_depth(color: Float[np.ndarray, "height width 3"], landmarks: Landmarks) -> float:
    """By how much the line of the lashes is darker than the lid above it, of the logarithm; 0 where
    a photo of linear ``color`` does not show it.
    """
    luminance = color @ np.array(REC709)
    floor = DARK * max(float(luminance.max()), 1e-9)
    found = []
    for lids in seen_lids(landmarks):
        if lids is None or lids.width < WIDTH_MIN:
            continue
        upper, up = landmarks.points[lids.pairs[:, 0]], lids.width * lids.across
        lid, line = (_along(luminance, upper, up, share, floor) for share in (LID, LINE))
        found.append(float(np.median(np.median(lid, axis=0) - line.min(axis=0))))
    if not found:
        return 0.0
    return float(np.clip(np.mean(found) - SHADE, 0.0, DARKEST))


def _along(
    luminance: Float[np.ndarray, "height width"],
    points: Float[np.ndarray, "points 2"],
    up: Float[np.ndarray, " 2"],
    shares: tuple[float, float],
    floor: float,
) -> Float[np.ndarray, "samples points"]:
    """Log luminance, above a ``floor``, from one share of the way ``up`` from the points to
    another.
    """
    at = points + np.linspace(*shares, SAMPLES)[:, None, None] * up
    # Pixel centres are at halves in the points, at whole numbers here.
    places = np.moveaxis(at - 0.5, -1, 0)[::-1]
    values = map_coordinates(luminance, places, order=1, mode="nearest")
    return np.asarray(np.log(np.maximum(values, floor)))
