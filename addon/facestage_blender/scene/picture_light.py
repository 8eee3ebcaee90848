"""The light of a picture of all directions on the stage's lights where they stand: non-negative
least squares over what a face, matte and glossy, would show of either.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from facestage.contract.environment import directions
from facestage.contract.errors import InputError

from ..pictures.images import image_pixels, load_image
from .relight import lights_on, take_back
from .stage import light_side, read_stage, require_stage, set_light_radiance
from .surroundings import empty_axes, show_world

NORMALS = 300  # of the face, all around
BEHIND = 0.3  # of the way that normals turned from the camera count, too: cheeks seen from the side
GLOSS_EXPONENT, GLOSS_WEIGHT = 16.0, 0.5
ROWS_MAX = 64  # of the picture that is looked at, means of its own
SWEEPS = 400
RIDGE = 1e-4  # of the diagonal: lights that look alike share


@dataclass(frozen=True)
class FaceLight:
    """What a face of many normals shows: (2 n, N) of each of the ``lights`` at radiance 1, (2 n, 3)
    of the picture and of the fitted lights; n matte rows, then glossy ones.
    """

    lights: list[bpy.types.Object]
    of_lights: np.ndarray
    of_picture: np.ndarray
    of_fitted: np.ndarray

    @property
    def matte(self) -> int:
        """How many rows are matte."""
        return len(self.of_lights) // 2

    def level(self, shown: np.ndarray) -> float:
        """By what ``shown`` (2 n, 3) must be brighter to be as bright as the fitted light."""
        wanted = self.of_fitted[: self.matte].sum()
        return float(wanted / max(float(shown[: self.matte].sum()), 1e-30))


def light_from_picture(scene: bpy.types.Scene, path: Path, degrees: float = 0.0) -> float:
    """Give the stage's lights the light of an equirectangular picture, turned by ``degrees`` about
    the vertical, at the fitted lights' brightness. Lights that are off stay off. Returns the share
    of the picture's light on a matte face that they can give.

    Raises InputError when no light is on, or the file holds no such picture.
    """
    face = _face_light(scene, smaller(read_picture(path)), degrees)
    take_back(scene)
    radiance = nonnegative(face.of_lights, face.of_picture)
    level = face.level(face.of_lights @ radiance)
    for light, value in zip(face.lights, level * radiance, strict=True):
        set_light_radiance(light, value, light_side(light))
    wanted = face.of_picture[: face.matte]
    rest = face.of_lights[: face.matte] @ radiance - wanted
    return float(1.0 - np.linalg.norm(rest) / np.linalg.norm(wanted))


def light_by_world(scene: bpy.types.Scene, path: Path, degrees: float = 0.0) -> None:
    """Let a world of the picture light the scene at the fitted lights' brightness, and the stage's
    lights be dark; :func:`.relight.take_back` undoes it. Raises InputError as
    :func:`light_from_picture`.
    """
    face = _face_light(scene, smaller(read_picture(path)), degrees)
    take_back(scene)
    show_world(scene, load_image(path), degrees, face.level(face.of_picture))
    for light in face.lights:
        set_light_radiance(light, np.zeros(3), light_side(light))


def _face_light(scene: bpy.types.Scene, picture: np.ndarray, degrees: float) -> FaceLight:
    lights = lights_on(scene)
    empty = require_stage(scene)
    stage = read_stage(empty)
    chosen = [index for index, _ in lights]
    distance = np.linalg.norm(stage.position[chosen], axis=1)
    outward = stage.position[chosen] / distance[:, None]
    # Solid angle of each, from the stage's centre.
    facing = np.maximum(-(stage.direction[chosen] * outward).sum(axis=1), 0.0)
    quarter = (0.5 * stage.side[chosen]) ** 2
    angles = facing * 4 * np.arcsin(quarter / (quarter + distance**2))
    height, width = picture.shape[:2]
    towards = directions(height, width, degrees).reshape(-1, 3) @ empty_axes(empty).T
    flux = picture_angles(height, width)[:, None] * picture.reshape(-1, 3)
    normals, weights = _normals()
    of_lights = _shown(normals, weights, outward, angles[:, None] * np.eye(len(lights)))
    fitted = np.array([light.facestage_light.fitted_radiance for _, light in lights])
    return FaceLight(
        [light for _, light in lights],
        of_lights,
        _shown(normals, weights, towards, flux),
        of_lights @ fitted,
    )


def read_picture(path: Path) -> np.ndarray:
    """(h, w, 3) linear radiance of all directions. Raises InputError for any other picture."""
    known = set(bpy.data.images)
    image = load_image(path)
    try:
        if not image.is_float:
            raise InputError(
                f"The picture '{path.name}' has 8 bits a channel, in which lamps are no brighter "
                "than walls; take an .exr or .hdr."
            )
        if image.size[0] != 2 * image.size[1]:
            raise InputError(
                f"The picture '{path.name}' has {image.size[0]} x {image.size[1]} pixels; one of "
                "all directions (equirectangular) is twice as wide as high."
            )
        pixels = image_pixels(image)[..., :3]
    finally:
        if image not in known:
            bpy.data.images.remove(image)
    if not np.isfinite(pixels).all() or not (pixels > 0).any():
        raise InputError(f"The picture '{path.name}' is black or damaged; choose another one.")
    return np.maximum(pixels, 0.0)


def smaller(picture: np.ndarray) -> np.ndarray:
    """(h, w, 3) the picture in at most ROWS_MAX rows, each the mean of those that it stands for."""
    factor = -(-len(picture) // ROWS_MAX)
    rows, columns = (size // factor for size in picture.shape[:2])
    cut = picture[: rows * factor, : columns * factor].astype(np.float64)
    mean: np.ndarray = cut.reshape(rows, factor, columns, factor, 3).mean(axis=(1, 3))
    return mean


def picture_angles(height: int, width: int) -> np.ndarray:
    """(h w,) solid angle of each pixel, sr."""
    edges = np.sin(np.pi * (0.5 - np.arange(height + 1) / height))
    return np.repeat((edges[:-1] - edges[1:]) * 2 * np.pi / width, width)


def nonnegative(columns: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    """(k, c) >= 0 that minimises |columns (r, k) x - wanted (r, c)|, by coordinate descent on the
    normal equations.
    """
    hessian = columns.T @ columns
    hessian[np.diag_indices(len(hessian))] *= 1.0 + RIDGE
    hessian[np.diag_indices(len(hessian))] += 1e-30
    right = columns.T @ wanted
    result = np.zeros_like(right)
    for _ in range(SWEEPS):
        for k in range(len(result)):
            gradient = hessian[k] @ result - right[k]
            result[k] = np.maximum(result[k] - gradient / hessian[k, k], 0.0)
    return result


def _normals() -> tuple[np.ndarray, np.ndarray]:
    """(n, 3) directions all around on a spiral, and how much each counts (n,): those that face the
    camera, along +z.
    """
    height = 1.0 - (2.0 * np.arange(NORMALS) + 1.0) / NORMALS
    turn = np.pi * (1.0 + 5.0**0.5) * np.arange(NORMALS)
    level = np.sqrt(1.0 - height**2)
    normals = np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=1)
    weights = np.clip((height + BEHIND) / (1.0 + BEHIND), 0.0, 1.0)
    return normals[weights > 0], weights[weights > 0]


def _shown(
    normals: np.ndarray, weights: np.ndarray, towards: np.ndarray, light: np.ndarray
) -> np.ndarray:
    """(2 n, c) what surfaces of these normals show, matte and glossy, of ``light`` (m, c), radiance
    times solid angle, from ``towards`` (m, 3).
    """
    cosine = np.maximum(normals @ towards.T, 0.0)
    gloss = GLOSS_WEIGHT * 0.5 * (GLOSS_EXPONENT + 1.0) * cosine**GLOSS_EXPONENT
    return np.concatenate([weights[:, None] * (kind @ light) for kind in (cosine, gloss)]) / np.pi
