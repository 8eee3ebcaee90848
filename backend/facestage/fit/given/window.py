"""The part of a large photo that is worked on, and at which size: a face of more pixels adds cost,
not detail.

The textures hold only so many texels along a side (see Fineness), so a face that is larger than
they can show is made smaller at once, and what is far from the face is cut off. Results are in
coordinates of the whole photo.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from facestage.contract.camera import Camera
from facestage.contract.landmarks import Landmarks
from facestage.contract.pins import Pins
from facestage.fit.given.fineness import USUAL, Fineness
from facestage.images.image_io import Photograph, resize

# How far around the landmarks' box the head may reach, neck and all, in longer sides of it.
MARGIN = 1.6
# A photo of how many times finer pixels is worth to be made smaller, or read once more.
WORTH = 1.25


@dataclass(frozen=True)
class Window:
    """``box`` = (left, top, right, bottom) of a photo of ``full`` = (width, height) pixels, resized
    by ``factor``.
    """

    full: tuple[int, int]
    box: tuple[int, int, int, int]
    factor: float = 1.0

    @classmethod
    def of(
        cls, width: int, height: int, landmarks: Landmarks, fineness: Fineness = USUAL
    ) -> Window:
        """The window for a face; all of a photo of few pixels, if smaller."""
        whole, full = (0, 0, width, height), (width, height)
        points = landmarks.points[landmarks.visible & np.isfinite(landmarks.points).all(axis=1)]
        if len(points) < 2:
            return cls(full, whole)
        low, high = points.min(axis=0), points.max(axis=0)
        side = max(float((high - low).max()), 1.0)
        if width * height <= fineness.photo_pixels:
            much = side >= WORTH * fineness.whole_face_px
            return cls(full, whole, fineness.whole_face_px / side if much else 1.0)
        left, top = (
            int(value) for value in np.clip(low - MARGIN * side, 0, [width - 1, height - 1])
        )
        right, bottom = (
            int(value) for value in np.clip(np.ceil(high + MARGIN * side), 1, [width, height])
        )
        return cls(full, (left, top, right, bottom), min(1.0, fineness.face_px / side))

    @property
    def whole(self) -> bool:
        """Whether it is the photo as it is."""
        return self.factor == 1.0 and self.uncut

    @property
    def uncut(self) -> bool:
        """Whether it is all of the photo."""
        return self.box == (0, 0, *self.full)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the window's own picture."""
        left, top, right, bottom = self.box
        return max(round((right - left) * self.factor), 1), max(
            round((bottom - top) * self.factor), 1
        )

    @property
    def words(self) -> str:
        """What was worked on, for the result."""
        full = f"{self.full[0]} x {self.full[1]}"
        if self.whole:
            return full
        left, top, right, bottom = self.box
        width, height = self.size
        return (
            f"{full}; worked on {right - left} x {bottom - top} pixels from ({left}, {top}), as "
            f"{width} x {height}; render.exr is enlarged from that"
        )

    def camera(self, camera: Camera) -> Camera:
        """The window's camera of the photo's ``camera``."""
        if self.whole:
            return camera
        (x, y), (left, top, _, _), (width, height) = camera.principal_px, self.box, self.size
        return Camera(
            width,
            height,
            camera.focal_px * self.factor,
            ((x - left) * self.factor, (y - top) * self.factor),
        )

    def full_camera(self, camera: Camera) -> Camera:
        """The photo's camera of the window's ``camera``."""
        if self.whole:
            return camera
        (x, y), (left, top, _, _) = camera.principal_px, self.box
        return Camera(
            *self.full,
            camera.focal_px / self.factor,
            (x / self.factor + left, y / self.factor + top),
        )

    def landmarks(self, landmarks: Landmarks) -> Landmarks:
        """The window's landmarks of the photo's."""
        if self.whole:
            return landmarks
        return replace(landmarks, points=(landmarks.points - np.array(self.box[:2])) * self.factor)

    def pins(self, pins: Pins) -> Pins:
        """The window's pins of the photo's."""
        points = (pins.points - np.array(self.box[:2])) * self.factor
        return replace(pins, points=points, deviation=pins.deviation * self.factor)

    def photograph(self, photo: Photograph) -> Photograph:
        """The window's pixels of a photo.

        A mixed pixel is masked, and saturated where a quarter of it is.
        """
        if self.whole:
            return photo
        left, top, right, bottom = self.box
        color, mask, clipped = (
            array[top:bottom, left:right] for array in (photo.color, photo.mask, photo.clipped)
        )
        if self.factor == 1.0:
            return replace(photo, color=color.copy(), mask=mask.copy(), clipped=clipped.copy())
        return replace(
            photo,
            color=resize(color, *self.size),
            mask=resize(mask.astype(np.float32), *self.size) > 0.99,
            clipped=resize(clipped.astype(np.float32), *self.size) > 0.25,
        )

    def enlarged(self, image: np.ndarray) -> np.ndarray:
        """The photo's size (h, w, 3) of a picture of the window, black around it."""
        if self.whole:
            return image
        left, top, right, bottom = self.box
        result = np.zeros((self.full[1], self.full[0], image.shape[2]), np.float32)
        result[top:bottom, left:right] = resize(image, right - left, bottom - top)
        return result
