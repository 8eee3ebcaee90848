"""Where a photo shows the skin that another one sees, as far as the fit knows it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from facestage.contract.arrays import Bool, Float, Int
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel, Surface
from facestage.images.opencv import opencv

# What a photo sees must lie this close, metres, to what the other one sees there: else something
# else of the face is before it.
DEPTH_TOLERANCE = 0.003
# Cosine of normal and view from which on skin is seen well enough to be compared.
FACING_MIN = 0.25
# Of the brightest light, what is added before the logarithm: black has no texture.
DARK_SHARE = 0.01
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


@dataclass(frozen=True, eq=False)
class Sight:
    """One photo, at one size, with the face where the fit has it."""

    forward: ForwardModel
    state: State  # with the camera of that size
    color: Float[np.ndarray, "height width 3"]  # linear
    usable: Bool[np.ndarray, "height width"]  # skin, and not hidden

    @cached_property
    def tone(self) -> Float[np.ndarray, "height width"]:
        """The logarithm of its luminance."""
        luminance = np.nan_to_num(self.color, nan=0.0, posinf=0.0, neginf=0.0) @ LUMINANCE
        face = luminance[self.usable]
        level = float(np.median(face)) if len(face) else 1.0
        return np.asarray(np.log(np.maximum(luminance, 0.0) + max(DARK_SHARE * level, 1e-9)))

    @cached_property
    def surface(self) -> Surface:
        """What the pixels around the face see of its skin."""
        height, width = self.usable.shape
        outline = self.state.camera.project(self.vertices[self.forward.geometry.fitted_vertices])
        limits = np.array([width, height])
        low = np.clip(np.floor(np.nan_to_num(outline.min(axis=0))), 0, limits).astype(int)
        high = np.clip(np.ceil(np.nan_to_num(outline.max(axis=0))), 0, limits).astype(int)
        y, x = np.mgrid[low[1] : high[1], low[0] : high[0]]
        pixels = np.stack([x.ravel(), y.ravel()], axis=1) + 0.5
        return self.forward.surface(self.state, pixels)

    @cached_property
    def distance(self) -> Float[np.ndarray, "height width"]:
        """From the camera to what is first seen of the face, metres; infinite beside it."""
        result = np.full(self.usable.shape, np.inf)
        column, row = self.surface.pixels.astype(int).T
        result[row, column] = self.surface.depth
        return result

    @cached_property
    def vertices(self) -> Float[np.ndarray, "vertices 3"]:
        """Of the rendered mesh, in the camera frame."""
        return self.forward.pose(self.state)[1]

    def facing(
        self, triangles: Int[np.ndarray, " points"], points: Float[np.ndarray, "points 3"]
    ) -> Float[np.ndarray, " points"]:
        """The cosine between the normals of ``triangles`` and the view at ``points`` of them."""
        a, b, c = np.moveaxis(self.vertices[self.forward.geometry.triangles[triangles]], 1, 0)
        normals = np.cross(b - a, c - a)
        length = np.linalg.norm(normals, axis=1) * np.linalg.norm(points, axis=1)
        return np.asarray(-np.einsum("px,px->p", normals, points) / np.maximum(length, 1e-20))


@dataclass(frozen=True, eq=False)
class Overlap:
    """What two photos both see, on a rectangle of pixels of the first."""

    corner: Int[np.ndarray, " 2"]  # x and y of the rectangle's first pixel
    tone: Float[np.ndarray, "height width"]  # the first photo's
    # where in the second photo the skin shows that a pixel of the first sees; 0 where unknown
    shown: Float[np.ndarray, "height width 2"]
    other_tone: Float[np.ndarray, "height width"]  # the second photo's there
    common: Bool[np.ndarray, "height width"]  # both see it


def overlap(first: Sight, second: Sight) -> Overlap | None:
    """Of two photos; None where the first one shows no skin."""
    fitted = first.forward.geometry.fitted[first.surface.triangle]
    if not fitted.any():
        return None
    surface = first.surface.part(fitted)
    points = np.einsum("pi,pix->px", surface.weights, second.vertices[surface.corners])
    seen = second.state.camera.project(points)
    common = _in_sight(second, points, seen)
    common &= first.facing(surface.triangle, surface.points) > FACING_MIN
    common &= second.facing(surface.triangle, points) > FACING_MIN
    column, row = surface.pixels.astype(int).T
    common &= first.usable[row, column] & (_sampled(second.usable, seen) > 0.99)
    low, high = np.array([column.min(), row.min()]), np.array([column.max(), row.max()]) + 1
    width, height = high - low
    place = row - low[1], column - low[0]
    shown, both, other = (
        np.zeros((height, width, 2)),
        np.zeros((height, width), bool),
        np.zeros((height, width)),
    )
    shown[place], both[place] = seen, common
    other[place] = _sampled(second.tone, seen, smooth=True)
    tone = first.tone[low[1] : high[1], low[0] : high[0]]
    return Overlap(low, tone, shown, other, both)


def _in_sight(sight: Sight, points: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """(p,) bool, whether nothing is before ``points`` (p, 3), which show at ``seen`` (p, 2)."""
    height, width = sight.distance.shape
    column, row = np.floor(np.nan_to_num(seen, nan=-1.0)).astype(int).T
    inside = (column >= 0) & (row >= 0) & (column < width) & (row < height)
    before = np.zeros(len(points))
    before[inside] = sight.distance[row[inside], column[inside]]
    return np.asarray(np.abs(before - np.linalg.norm(points, axis=1)) < DEPTH_TOLERANCE)


def _sampled(picture: np.ndarray, places: np.ndarray, smooth: bool = False) -> np.ndarray:
    """(p,) values of ``picture`` (h, w) at ``places`` (p, 2); 0 outside."""
    cv2 = opencv()
    at = (places - 0.5).astype(np.float32)[:, None]
    how = cv2.INTER_CUBIC if smooth else cv2.INTER_LINEAR
    # OpenCV takes at most 32767 places along a side.
    parts = np.array_split(at, max(1, -(-len(at) // 30000)))
    image = picture.astype(np.float32)
    found = [cv2.remap(image, part, None, how, borderMode=cv2.BORDER_CONSTANT) for part in parts]
    return np.concatenate(found)[:, 0].astype(np.float64)
