"""The same skin in two photos: which pixel of one shows what which place of the other does."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_erosion

from facestage.contract.arrays import Bool, Float
from facestage.fit.stereo.correlation import (
    BANDS,
    WINDOW_AREA,
    WINDOW_PX,
    Displacements,
    detail,
    displacements,
    kept_places,
    surest,
    textured,
)
from facestage.fit.stereo.overlap import Overlap, Sight, overlap
from facestage.images.opencv import opencv

# A match is kept every so many pixels: neighbours within a window say the same.
SPACING = round(WINDOW_PX)
# Matches of one surface move alike: within so many places the median of at least so many others may
# not be further away than this, pixels.
AROUND, NEIGHBOURS_MIN, DISAGREEMENT_MAX = 2, 8, 1.5
# With fewer, in pixels of a common overlap or in matches, chance finds as many.
OVERLAP_MIN, MATCHES_MIN = 400, 25
# Share of the textured places below which what agrees is chance, or lips on anybody's lips.
LIKENESS_MIN = 0.2


@dataclass(frozen=True, eq=False)
class Matches:
    """Places of two photos that show the same skin, in pixels of each."""

    pixels: Float[np.ndarray, "matches 2"]  # of the first photo
    targets: Float[np.ndarray, "matches 2"]  # in the second photo
    covariance: Float[np.ndarray, "matches 2 2"]  # of the targets, pixels^2
    share: float  # of an independent match that each is

    def scaled(self, first: float, second: float) -> Matches:
        """Of the photos resized by these factors."""
        return replace(
            self,
            pixels=first * self.pixels,
            targets=second * self.targets,
            covariance=second**2 * self.covariance,
        )


@dataclass(frozen=True, eq=False)
class Comparison:
    """What two photos have in common."""

    matches: Matches | None  # None where they say nothing of each other's shape
    textured: int  # places a window apart where both photos show skin with texture
    recognised: int  # of these, the places that were matched

    @property
    def likeness(self) -> float:
        """The share of the textured places that were matched."""
        return self.recognised / max(self.textured, 1)


NOTHING = Comparison(None, 0, 0)


def compare(first: Sight, second: Sight, reach: int) -> Comparison:
    """Two photos with the faces where the fit has them, off by up to ``reach`` pixels."""
    both = overlap(first, second)
    if both is None or both.common.sum() < OVERLAP_MIN:
        return NOTHING
    common, here = both.common, kept_places(SPACING)
    well_inside = binary_erosion(common, iterations=SPACING)[here]
    found, likeness = [], []
    for band in BANDS:
        details = [detail(tone, common, band) for tone in (both.tone, both.other_tone)]
        moved = displacements(details[0], details[1], common, reach, band, SPACING)
        rich = well_inside.copy()
        for one in details:
            rich &= textured(one, common, band)[here]
        sure = _agreeing(moved.shift, common[here] & moved.sure)
        found.append(moved)
        likeness.append((int(rich.sum()), int((rich & sure).sum())))
    # Who it is, the finest detail tells: lips lie on anybody's lips.
    textured_places, recognised = likeness[0]
    if all(same < LIKENESS_MIN * places for places, same in likeness):
        return Comparison(None, textured_places, recognised)
    moved = surest(found)
    sure = _agreeing(moved.shift, common[here] & moved.sure)
    return Comparison(_matches(both, moved, sure), textured_places, recognised)


def _agreeing(
    shift: Float[np.ndarray, "rows columns 2"], sure: Bool[np.ndarray, "rows columns"]
) -> Bool[np.ndarray, "rows columns"]:
    """Those of ``sure`` that move as their surroundings do."""
    rows, columns = sure.shape
    known = np.where(sure[..., None], shift, np.nan)
    known = np.pad(known, ((AROUND, AROUND), (AROUND, AROUND), (0, 0)), constant_values=np.nan)
    steps = range(2 * AROUND + 1)
    around = np.stack([known[j : j + rows, i : i + columns][sure] for j in steps for i in steps])
    enough = np.isfinite(around[..., 0]).sum(axis=0) > NEIGHBOURS_MIN
    # The place itself is among them.
    off = shift[sure] - np.nanmedian(around, axis=0)
    result = sure.copy()
    result[sure] = enough & (np.linalg.norm(off, axis=-1) < DISAGREEMENT_MAX)
    return result


def _matches(
    both: Overlap, moved: Displacements, sure: Bool[np.ndarray, "rows columns"]
) -> Matches | None:
    """The ``sure`` places, carried into the second photo."""
    cv2, here = opencv(), kept_places(SPACING)
    height, width = both.common.shape
    y, x = np.mgrid[:height, :width]
    pixels = np.stack([x[here], y[here]], axis=-1)
    at = (pixels + moved.shift).astype(np.float32)
    # Where all pixels around the place are known, for values and for slopes.
    firm = binary_erosion(both.common, np.ones((3, 3)))
    place = at[..., 0], at[..., 1]
    targets = cv2.remap(both.shown.astype(np.float32), *place, cv2.INTER_LINEAR)
    known = cv2.remap(firm.astype(np.float32), *place, cv2.INTER_LINEAR) > 0.99
    chosen = sure & known & firm[here]
    if chosen.sum() < MATCHES_MIN:
        return None
    # How the second photo's pixels move with the first one's.
    stretch = np.stack(np.gradient(both.shown, axis=(1, 0)), axis=-1)[here][chosen]
    covariance = np.linalg.inv(moved.information[chosen])
    return Matches(
        pixels[chosen] + both.corner + 0.5,
        targets[chosen].astype(np.float64),
        stretch @ covariance @ stretch.transpose(0, 2, 1),
        SPACING**2 / WINDOW_AREA,
    )
