"""Where the photo has the edge of the face, across a line through a point of the mesh's outline."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.ndimage import map_coordinates

from facestage.contract.arrays import Bool, Float
from facestage.fit.given.photo import Photo

# How far to either side an edge is looked for at once, a share of the face's size; from there
# outward so many times further.
REACH_SHARE, FURTHER = 0.025, 3
STEP_PX = 0.5
# Face and background must differ by this share of the brighter, and the profile be a step up to
# this mean error.
CONTRAST_MIN, STEP_ERROR_MAX = 0.35, 0.15
# Cosine of the angle between an edge and the mesh's outline: below the jaw's angle the neck's edge
# comes next, and runs another way.
ALIGNED_MIN = 0.9
# How much of the profile's inner end, and of the way to an edge further out, must have the face's
# own color: hair in front of a cheek is not its outline.
SKIN_INSIDE_MIN = 0.6
FLOOR_SHARE = 0.1
# Places along the way to an edge further out.
_ON_THE_WAY = np.linspace(0.1, 0.9, 9)


@dataclass(frozen=True)
class EdgeSearch:
    """Looks for edges in a photo whose face is ``face_px`` pixels large."""

    photo: Photo
    face_px: float

    @property
    def reach(self) -> float:
        """Pixels to either side of a point."""
        return max(REACH_SHARE * self.face_px, 2.0)

    def nearest(
        self,
        middle: Float[np.ndarray, "points 2"],
        normal: Float[np.ndarray, "points 2"],
        further: Bool[np.ndarray, " points"],
    ) -> Float[np.ndarray, " points"]:
        """Pixels along the outward ``normal`` from ``middle`` to the face's edge; NaN where the
        photo shows none.

        Where ``further`` says so it is followed outward as far as all on the way is skin: a face
        that is too narrow shows a strip of skin beside it.
        """
        result = self.offset(middle, normal)
        for shift in range(1, 1 + FURTHER):
            left = np.flatnonzero(further & np.isnan(result))
            away = shift * self.reach
            found = away + self.offset(middle[left] + away * normal[left], normal[left])
            # At the end of the reach a profile is cut off: look again from the edge itself.
            there = np.nan_to_num(middle[left] + found[:, None] * normal[left])
            found += np.nan_to_num(self.offset(there, normal[left]))
            skin = self._skin_on_the_way(middle[left], found[:, None] * normal[left])
            result[left] = np.where(skin > SKIN_INSIDE_MIN, found, np.nan)
        return result

    def _skin_on_the_way(
        self, middle: Float[np.ndarray, "points 2"], way: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, " points"]:
        at = np.nan_to_num(middle[:, None] + _ON_THE_WAY[:, None] * way[:, None])
        return np.asarray(_at(self.photo.skin, at, 1).mean(axis=1))

    def offset(
        self, middle: Float[np.ndarray, "points 2"], normal: Float[np.ndarray, "points 2"]
    ) -> Float[np.ndarray, " points"]:
        """Likewise, within :attr:`reach`."""
        count = int(np.ceil(self.reach / STEP_PX))
        reach = count * STEP_PX
        steps = np.arange(-2 * count, 2 * count + 1) * STEP_PX
        at = middle[:, None] + steps[:, None] * normal[:, None]  # (m, s, 2)
        photo = self.photo
        height, width = photo.usable.shape
        color = _at(photo.color, at, 1)
        usable = _at(photo.usable.astype(np.float64), at, 0) > 0
        skin = _at(photo.skin, at, 1)
        inner, outer, window = steps <= -reach, steps >= reach, np.abs(steps) < reach
        face, back = color[:, inner].mean(axis=1), color[:, outer].mean(axis=1)
        difference = face - back
        floor = FLOOR_SHARE * float(photo.color[photo.usable].mean()) if photo.usable.any() else 1.0
        brighter = np.maximum(np.linalg.norm(face, axis=1), np.linalg.norm(back, axis=1))
        contrast = np.linalg.norm(difference, axis=1) / (brighter + floor)
        coverage = np.einsum("msc,mc->ms", color - back[:, None], difference)
        coverage = np.clip(coverage / np.maximum((difference**2).sum(axis=1), 1e-20)[:, None], 0, 1)
        offset = -reach + STEP_PX * (coverage[:, window].sum(axis=1) + 0.5)
        step = np.clip(0.5 - (steps[window] - offset[:, None]), 0, 1)
        error = np.abs(coverage[:, window] - step).mean(axis=1)
        good = usable.all(axis=1) & (contrast > CONTRAST_MIN) & (error < STEP_ERROR_MAX)
        good &= skin[:, inner].mean(axis=1) > SKIN_INSIDE_MIN
        good &= ((at > 0) & (at < [width, height])).all(axis=(1, 2))
        good &= self._alignment(middle + offset[:, None] * normal, normal, difference) > ALIGNED_MIN
        return np.where(good, offset, np.nan)

    def _alignment(
        self,
        place: Float[np.ndarray, "points 2"],
        normal: Float[np.ndarray, "points 2"],
        difference: Float[np.ndarray, "points 3"],
    ) -> Float[np.ndarray, " points"]:
        """The cosine between ``normal`` and the way on which the photo turns from face to
        background, ``difference`` being face less background.
        """
        slope = np.stack([_at(part, place, 1) for part in self._slopes])
        towards_back = -np.einsum("xmc,mc->mx", slope, difference)
        length = np.maximum(np.linalg.norm(towards_back, axis=1), 1e-20)
        return np.asarray(np.einsum("mx,mx->m", towards_back, normal) / length)

    @cached_property
    def _slopes(self) -> list[np.ndarray]:
        """(h, w, 3) of the color along x and along y, per pixel."""
        return list(np.gradient(self.photo.color, axis=(1, 0)))


def _at(image: np.ndarray, place: Float[np.ndarray, "... 2"], order: int) -> np.ndarray:
    """``image`` (h, w) or (h, w, c) at pixels: (...) or (..., c)."""
    if image.ndim > 2:
        return np.stack([_at(channel, place, order) for channel in np.moveaxis(image, 2, 0)], -1)
    rows_and_columns = [place[..., 1] - 0.5, place[..., 0] - 0.5]
    return np.asarray(map_coordinates(image, rows_and_columns, order=order))
