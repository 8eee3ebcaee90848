"""What was detected, drawn over the photo."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.atomic import atomic_file
from facestage.images.image_io import Photograph
from facestage.images.opencv import opencv
from facestage.landmarks.canonical import CanonicalFace
from facestage.landmarks.crop import Crop
from facestage.landmarks.finder import Face
from facestage.landmarks.views import PhotoViews

# Longer side of the picture, pixels: small photos are enlarged so that points can be told apart.
SIDE_MIN, SIDE_MAX = 1024, 2048
# RGB.
EDGE, HIDDEN_EDGE = (120, 200, 255), (110, 90, 120)
POINT, HIDDEN_POINT = (80, 255, 120), (255, 70, 90)
CHOSEN_BOX, OTHER_BOX = (255, 210, 60), (190, 190, 190)
# Radius of a point over the face's size, and its bounds in pixels of the picture.
DOT_SHARE, DOT_RADII = 0.006, (1.0, 4.0)
SUBPIXEL = 4  # fractional bits of OpenCV's coordinates


def draw_faces(
    path: Path, photograph: Photograph, faces: list[Face], chosen: int, canonical: CanonicalFace
) -> None:
    """Write a picture of the photo with every face's box, and the mesh of ``faces[chosen]``; hidden
    parts differ.

    Raises InputError when the file cannot be written.
    """
    cv2 = opencv()
    width, height = photograph.size
    factor = float(np.clip(1.0, SIDE_MIN / max(width, height), SIDE_MAX / max(width, height)))
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    canvas = _display(photograph, size)
    mesh = faces[chosen].mesh.points[:, :2]
    seen = faces[chosen].visible
    for hidden in (True, False):
        for first, second in canonical.edges:
            if (seen[first] and seen[second]) != hidden:
                color = HIDDEN_EDGE if hidden else EDGE
                ends = [_fixed(mesh[corner], factor) for corner in (first, second)]
                cv2.line(canvas, *ends, color, 1, cv2.LINE_AA, SUBPIXEL)
    radius = round(
        float(np.clip(faces[chosen].size * factor * DOT_SHARE, *DOT_RADII)) * 2**SUBPIXEL
    )
    for point, visible in zip(mesh, seen, strict=True):
        color = POINT if visible else HIDDEN_POINT
        cv2.circle(canvas, _fixed(point, factor), radius, color, cv2.FILLED, cv2.LINE_AA, SUBPIXEL)
    for number, face in enumerate(faces):
        _draw_box(
            canvas, face, factor, f"{number + 1}", CHOSEN_BOX if number == chosen else OTHER_BOX
        )
    with atomic_file(path) as temporary:
        if not cv2.imwrite(str(temporary), canvas[..., ::-1]):
            raise InputError(f"Cannot write the picture '{path}'; is the disk full?")


def _display(photograph: Photograph, size: tuple[int, int]) -> np.ndarray:
    """(h, w, 3) uint8 sRGB."""
    cv2 = opencv()
    views = PhotoViews(photograph)
    side = max(photograph.size)
    square = views.sample(
        Crop(np.array([side, side]) / 2, float(side)), max(size), repeat_border=False
    )
    picture = square[: size[1], : size[0]]
    return np.ascontiguousarray(cv2.convertScaleAbs(picture, alpha=255.0))


def _fixed(point: np.ndarray, factor: float) -> tuple[int, int]:
    """OpenCV's coordinates of a point of the photo; OpenCV counts from the first pixel's centre."""
    x, y = np.round((point * factor - 0.5) * 2**SUBPIXEL).astype(int)
    return int(x), int(y)


def _draw_box(
    canvas: np.ndarray, face: Face, factor: float, text: str, color: tuple[int, int, int]
) -> None:
    cv2 = opencv()
    crop = face.mesh.crop
    corners = Crop(crop.center, face.size, crop.angle).to_photo(
        np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    )
    fixed = np.array([_fixed(corner, factor) for corner in corners], np.int32)
    cv2.polylines(canvas, [fixed], True, color, 2, cv2.LINE_AA, SUBPIXEL)
    left, top = corners.min(axis=0) * factor
    place = (max(2, int(left)), max(24, int(top) - 6))
    cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.9, color, 2, cv2.LINE_AA)
