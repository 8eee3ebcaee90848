"""The picture of the eyes: their part of the UV square, in texels enough for close views."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

from facestage.contract.arrays import Float, Float32
from facestage.contract.face_model import EYES, FaceModel
from facestage.contract.texture_maps import uv_box
from facestage.fit.face.eye_white import IRIS_MAX
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.textures.atlas import Atlas, nearest_covered, shown_at, uv_tracer
from facestage.fit.textures.eyes.eye_pattern import REACH, eye_albedo
from facestage.fit.textures.eyes.lid_shade import LidShade
from facestage.fit.textures.eyes.part_color import LUMINANCE, PUPIL_MAX
from facestage.images.opencv import opencv

TEXELS = 2**20  # of the picture
SIDES = ("eye_left", "eye_right")
# How far the axis of an eyeball may lie from the middle of what the model paints as iris, metres.
AXIS_OFF_MAX = 0.0015


@dataclass(frozen=True)
class EyePlane:
    """Where the vertices of the rendered mesh lie on their eyeball, seen along its axis."""

    across: Float[np.ndarray, "vertices 2"]  # metres from the axis, to the left and up
    side: Float[np.ndarray, " vertices"]  # 0 the left eye, 1 the right one, -1 none

    @classmethod
    def of(cls, geometry: FaceGeometry) -> EyePlane | None:
        """None where the model has no two eyeballs with an iris round the middle of each."""
        across = np.zeros((len(geometry.mean), 2))
        side = np.full(len(geometry.mean), -1.0)
        luminance = np.exp(geometry.log_albedo) @ LUMINANCE
        for number, name in enumerate(SIDES):
            ball = geometry.new_index[geometry.model.regions.get(name, np.zeros(0, int))]
            ball = ball[ball >= 0]
            iris = ball[luminance[ball] < IRIS_MAX]
            if not len(iris):
                return None
            points = geometry.mean[ball]
            centre = 0.5 * (points.min(axis=0) + points.max(axis=0))
            off = geometry.mean[iris, :2].mean(axis=0) - centre[:2]
            if np.hypot(*off) > AXIS_OFF_MAX:
                return None
            found = points[:, :2] - centre[:2]
            # What is turned away from the front shows neither iris nor vessels.
            behind = points[:, 2] < centre[2]
            length = np.maximum(np.hypot(*found.T), 1e-9)
            found[behind] *= (REACH / length[behind])[:, None]
            across[ball], side[ball] = found, number
        return cls(across, side)


@dataclass(frozen=True)
class EyeColors:
    """Linear albedo of the iris and of the white of the eyes."""

    iris: Float[np.ndarray, " 3"]
    white: Float[np.ndarray, " 3"]

    @classmethod
    def of(cls, geometry: FaceGeometry, log_albedo: Float[np.ndarray, "vertices 3"]) -> EyeColors:
        """As ``log_albedo`` (of the rendered vertices) has them where the model paints them."""
        eyes = np.zeros(len(log_albedo), bool)
        eyes[geometry.triangles[geometry.triangle_part == EYES]] = True
        painted = np.exp(geometry.log_albedo) @ LUMINANCE
        iris = eyes & (painted < IRIS_MAX) & (painted > PUPIL_MAX)
        white = eyes & (painted >= IRIS_MAX)
        return cls(*(np.exp(np.median(log_albedo[each], axis=0)) for each in (iris, white)))


def eye_box(model: FaceModel) -> tuple[float, float, float, float]:
    """The part of the UV square that the picture shows, see :func:`uv_box`."""
    return uv_box(model.uvs[np.unique(model.triangle_uvs[model.triangle_part == EYES])])


def eye_picture(
    geometry: FaceGeometry,
    log_albedo: Float[np.ndarray, "vertices 3"],
    shade: LidShade | None = None,
    iris_size: float = 1.0,
) -> Float32[np.ndarray, "height width 3"] | None:
    """Linear albedo, row 0 at the top of :func:`eye_box`, in the colors that ``log_albedo`` has,
    below the ``shade`` of the lids; ``iris_size`` as a share of the model's.

    Texels that show nothing repeat the nearest that does. None: the model has no such eyes.
    """
    plane = EyePlane.of(geometry)
    if plane is None:
        return None
    colors = EyeColors.of(geometry, log_albedo)
    left, bottom, right, top = eye_box(geometry.model)
    width = int(np.sqrt(TEXELS * (right - left) / (top - bottom)))
    height = TEXELS // width
    v, u = np.mgrid[:height, :width]
    hits = shown_at(
        uv_tracer(geometry),
        left + (u + 0.5) / width * (right - left),
        top - (v + 0.5) / height * (top - bottom),
    )
    shown = hits.triangle >= 0
    shown[shown] = geometry.triangle_part[hits.triangle[shown]] == EYES
    corners, weights = geometry.triangles[hits.triangle[shown]], hits.barycentric[shown]
    across = np.einsum("ti,tix->tx", weights, plane.across[corners])
    side = plane.side[corners[:, 0]]
    found = np.zeros((len(across), 3), np.float32)
    for number in range(len(SIDES)):
        own = side == number
        found[own] = eye_albedo(across[own], colors.iris, colors.white, number, iris_size)
        if shade is not None:
            found[own] *= np.exp(shade.log_change(across[own], number))[:, None]
    picture = np.zeros((height * width, 3), np.float32)
    picture[shown] = found
    picture[~shown] = picture[nearest_covered(shown.reshape(height, width))]
    return picture.reshape(height, width, 3)


def eyes_painted(
    albedo: Float32[np.ndarray, "size size 3"],
    atlas: Atlas,
    geometry: FaceGeometry,
    picture: Float32[np.ndarray, "height width 3"],
) -> Float32[np.ndarray, "size size 3"]:
    """The texture with the ``picture`` of the eyes in its place, each texel the mean of what it
    covers.
    """
    cv2 = opencv()
    left, bottom, right, top = eye_box(geometry.model)
    size = max(round((right - left) * atlas.size), 1), max(round((top - bottom) * atlas.size), 1)
    if size[0] < picture.shape[1]:
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    eyes = np.zeros(albedo.shape[:2], bool)
    eyes[atlas.covered] = geometry.triangle_part[atlas.triangle] == EYES
    row, column = np.nonzero(eyes)
    u, v = (column + 0.5) / atlas.size, 1 - (row + 0.5) / atlas.size
    height, width = picture.shape[:2]
    at = [(top - v) / (top - bottom) * height - 0.5, (u - left) / (right - left) * width - 0.5]
    painted = albedo.copy()
    for channel in range(3):
        painted[row, column, channel] = map_coordinates(
            picture[..., channel], at, order=1, mode="nearest"
        )
    atlas.spread(painted)
    return painted
