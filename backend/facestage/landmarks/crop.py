"""A square of the photo, turned and perhaps mirrored: what a network looks at."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Crop:
    """A square around ``center`` (2,) pixels, ``side`` pixels wide, its x axis turned by ``angle``
    radians.

    Angles turn from x (right) to y (down). Coordinates inside run from 0 to 1 along both sides; in
    a mirrored crop the first runs from right to left. Pixels have the contract's convention: the
    first one's centre is (0.5, 0.5).
    """

    center: np.ndarray
    side: float
    angle: float = 0.0
    mirrored: bool = False

    @property
    def axes(self) -> np.ndarray:
        """(2, 2), its columns the photo's pixels along the crop's whole sides."""
        cosine, sine = np.cos(self.angle), np.sin(self.angle)
        across = self.side * np.array([cosine, sine])
        down = self.side * np.array([-sine, cosine])
        return np.stack([-across if self.mirrored else across, down], axis=1)

    def to_photo(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) pixels of the photo for points of the crop."""
        return (np.asarray(points) - 0.5) @ self.axes.T + self.center

    def from_photo(self, points: np.ndarray) -> np.ndarray:
        """(..., 2) points of the crop for pixels of the photo."""
        return (np.asarray(points) - self.center) @ np.linalg.inv(self.axes).T + 0.5

    def mirror(self) -> Crop:
        """The same square seen in a mirror."""
        return replace(self, mirrored=not self.mirrored)


def crop_around(points: np.ndarray, angle: float, margin: float) -> Crop:
    """The square turned by ``angle`` whose side is ``margin`` times the longer extent of ``points``
    (m, 2).
    """
    upright = Crop(np.zeros(2), 1.0, angle)
    inside = upright.from_photo(points)
    low, high = inside.min(axis=0), inside.max(axis=0)
    return Crop(upright.to_photo((low + high) / 2), margin * float((high - low).max()), angle)
