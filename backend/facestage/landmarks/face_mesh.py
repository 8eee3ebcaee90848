"""The face mesh network (Grishchenko et al. 2020, "Attention Mesh"): 478 points of the face in a
square.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.images.opencv import opencv
from facestage.landmarks.crop import Crop, crop_around
from facestage.landmarks.views import PhotoViews

SIZE = 256  # pixels of the network's input
COUNT = 478
MARGIN = 1.5  # side of the crop over that of the mesh's box
RIGHT_EYE_OUTER, LEFT_EYE_OUTER = 33, 263


@dataclass(frozen=True, eq=False)
class Mesh:
    """Points (478, 3) of a face: x, y in pixels of the photo, z in the same unit, growing away from
    the camera.

    ``presence`` in 0..1 is how sure the network is that it looked at a face.
    """

    points: np.ndarray
    presence: float

    @property
    def roll(self) -> float:
        """Radians from the photo's x axis to the line from the person's right eye to the left."""
        across = self.points[LEFT_EYE_OUTER, :2] - self.points[RIGHT_EYE_OUTER, :2]
        return float(np.arctan2(across[1], across[0]))

    @property
    def crop(self) -> Crop:
        """The square that the network wants to see of this face."""
        return crop_around(self.points[:, :2], self.roll, MARGIN)


class FaceMesh:
    """Runs the network on squares of a photo."""

    def __init__(self, tflite: bytes) -> None:
        cv2 = opencv()
        self._net = cv2.dnn.readNetFromTFLite(np.frombuffer(tflite, np.uint8))

    def predict(self, views: PhotoViews, crop: Crop) -> Mesh:
        """The mesh of the face in a square of the photo."""
        image = views.sample(crop, SIZE, repeat_border=True)
        self._net.setInput(np.ascontiguousarray(image.transpose(2, 0, 1)[None]))
        raw, logit = self._net.forward(["Identity", "Identity_1"])
        inside = raw.reshape(COUNT, 3).astype(np.float64) / SIZE
        points = np.column_stack([crop.to_photo(inside[:, :2]), inside[:, 2] * crop.side])
        return Mesh(
            points, float(1.0 / (1.0 + np.exp(-np.clip(float(logit.ravel()[0]), -80.0, 80.0))))
        )
