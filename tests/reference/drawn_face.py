"""An ellipsoid of skin under a lamp before a grey wall, with a real face's landmarks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from facestage.contract.landmarks import Landmarks

SKIN = {"light": (0.72, 0.52, 0.44), "dark": (0.16, 0.085, 0.05)}
LANDMARKS = Path(__file__).parents[2] / "addon/facestage_blender/headless/data"
# Pixels, at a scale of 1.
SIDE, CENTER, RADII = 160, np.array([80.0, 78.0]), np.array([46.0, 60.0])


@dataclass(frozen=True)
class DrawnFace:
    """``scale`` times 160 pixels a side."""

    scale: int

    @property
    def grid(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the pixels' centers, in pixels at a scale of 1."""
        y, x = (np.mgrid[: SIDE * self.scale, : SIDE * self.scale] + 0.5) / self.scale
        return y, x

    @property
    def landmarks(self) -> Landmarks:
        """A real face's, moved into the drawn one."""
        found = Landmarks.read(LANDMARKS / "astronaut_landmarks.json")
        low, high = found.points.min(axis=0), found.points.max(axis=0)
        points = (found.points - low) / (high - low) * [72, 76] + CENTER + [-36, -22]
        return Landmarks("ibug68", points * self.scale, found.visible)

    def draw(
        self, skin: str, light: tuple[float, float, float] = (0.6, 0.3, 0.75), crown: float = 1.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """(h, w, 3) linear, and (h, w) bool where the face is; ``crown`` times as high above its
        middle.
        """
        rows, columns = self.grid
        x, y = (columns - CENTER[0]) / RADII[0], (rows - CENTER[1]) / RADII[1]
        y = np.where(y < 0, y / crown, y)
        inside = x**2 + y**2 < 1
        z = np.sqrt(np.maximum(1 - x**2 - y**2, 0))
        cosine = np.maximum(x * light[0] - y * light[1] + z * light[2], 0)
        # Pores and blotches, as smooth as the skin of a face is not.
        uneven = 1 + 0.04 * np.sin(columns / 3.1) * np.cos(rows / 2.3)
        shade = ((0.08 + 0.9 * cosine) * uneven)[..., None] * np.array(SKIN[skin])
        return np.where(inside[..., None], shade, [0.25, 0.27, 0.3]), inside
