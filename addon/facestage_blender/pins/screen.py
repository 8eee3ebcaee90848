"""Where the photo's pixels are in a 3D View that looks through the camera. No bpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.camera import Camera


@dataclass(frozen=True)
class PhotoOnScreen:
    """``matrix`` (2, 3) takes (x, y, 1) in pixels of the photo to pixels of the region."""

    matrix: Float[np.ndarray, "2 3"]

    @classmethod
    def of(
        cls,
        perspective: Float[np.ndarray, "4 4"],
        size: tuple[float, float],
        camera_pose: Float[np.ndarray, "4 4"],
        lens: Camera,
    ) -> PhotoOnScreen:
        """From the view's matrix from the world and the size of its region in pixels."""
        corners = np.array([[0.0, 0.0], [lens.width, 0.0], [0.0, lens.height]])
        rays = (corners - lens.principal_px) * [1.0, -1.0] / lens.focal_px
        points = np.c_[rays, -np.ones(3), np.ones(3)] @ camera_pose.T @ perspective.T
        seen = (0.5 + 0.5 * points[:, :2] / points[:, 3:]) * size
        columns = (seen[1] - seen[0]) / lens.width, (seen[2] - seen[0]) / lens.height
        return cls(np.stack([*columns, seen[0]], axis=1))

    @property
    def scale(self) -> float:
        """Pixels of the region for one of the photo."""
        return float(np.sqrt(abs(np.linalg.det(self.matrix[:, :2]))))

    def to_region(self, pixels: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2"]:
        """Where pixels of the photo are."""
        return np.asarray(pixels @ self.matrix[:, :2].T + self.matrix[:, 2])

    def to_photo(self, place: tuple[float, float]) -> Float[np.ndarray, " 2"]:
        """The photo's pixel at a place of the region."""
        away = np.asarray(place, np.float64) - self.matrix[:, 2]
        return np.asarray(np.linalg.solve(self.matrix[:, :2], away))
