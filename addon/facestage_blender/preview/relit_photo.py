"""The photo with the fitted face under other lights: from the result's relight cache, for the
scene's lights.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.files.color import srgb_to_linear
from facestage.contract.light_stage import LightStage
from facestage.contract.relight_cache import RELIGHT_CACHE, RelightCache
from facestage.contract.result import Result

from ..pictures.images import image_pixels, load_image
from ..rig.face_rig import SLIDER_LIMIT, read_weights, rig_axes
from ..rig.own_record import OwnMesh
from ..rig.relief_key import shown_relief
from ..scene import frames
from ..scene.camera import read_camera
from ..scene.paths import absolute
from ..scene.relight import lit_by_world
from ..scene.softbox import softbox_of
from ..scene.stage import relative_matrix

# Where the fitted face is darker than this share of its median, the photo divided by it is noise.
FLOOR = 0.05
BRIGHTEST = 8.0  # times the photo: more would show its noise alone
TOLERANCE = 1e-4  # metres and unit vectors; Blender keeps single floats


@dataclass(frozen=True)
class RelitPhoto:
    """What a result shows under any radiance of its lights, in the order of Blender's pixels (row 0
    at the bottom).
    """

    result: Result
    cache: RelightCache
    changed: int  # when the cache was written, ns
    # (h w, 4) float32 linear RGBA, of the cache's size; black where there is no photo
    photo: np.ndarray
    places: np.ndarray  # (P,) int, the cache's pixels in it
    behind: np.ndarray  # (P, 3) what those pixels show beside the head
    # (P, 3) what they show of the head in the photo; None where there is no photo
    front: np.ndarray | None
    fitted: np.ndarray  # (P, 3) the head under the fitted lights
    floor: np.ndarray  # (3,) of the fitted radiance

    @classmethod
    def load(cls, folder: Path, photo: str) -> RelitPhoto:
        """Of the result in ``folder``. Raises InputError when it has no usable relight cache."""
        result = Result.load(folder)
        cache = RelightCache.load(result)
        row, column = np.divmod(cache.pixels, cache.width)
        places = (cache.height - 1 - row) * cache.width + column
        shown = _photo_pixels(photo, cache.width, cache.height)
        pixels = np.zeros((cache.height * cache.width, 4), np.float32) if shown is None else shown
        pixels[:, 3] = 1
        coverage, fitted = cache.coverage[:, None], cache.colors(result.stage.radiance)
        return cls(
            result,
            cache,
            changed_at(folder),
            photo=pixels,
            places=places,
            behind=(1 - coverage) * pixels[places, :3],
            front=None if shown is None else coverage * pixels[places, :3],
            fitted=fitted,
            floor=FLOOR * np.median(fitted, axis=0) + np.finfo(np.float32).tiny,
        )

    @property
    def size(self) -> tuple[int, int]:
        """Width and height in pixels."""
        return self.cache.width, self.cache.height

    def pixels(self, radiance: np.ndarray) -> np.ndarray:
        """(h w, 4) float32 linear RGBA: the face under ``radiance`` (N, 3), around it the photo as
        it is.

        The photo times relit over fitted (a ratio image; Liu, Shan and Zhang 2001): hair, beard and
        pores that no fit has stay, and the fitted light gives back the photo itself.
        """
        relit, pixels = self.cache.colors(radiance), self.photo.copy()
        if self.front is not None:
            level = relit.sum(axis=0) / np.maximum(self.fitted.sum(axis=0), self.floor)
            ratio = (relit + level * self.floor) / (self.fitted + self.floor)
            relit = self.front * np.minimum(ratio, BRIGHTEST)
        pixels[self.places, :3] = self.behind + relit
        return pixels

    def difference(self, scene: bpy.types.Scene, stage: LightStage) -> str:
        """What of the scene is no longer as in the result, beyond the lights' radiance; empty when
        nothing is.
        """
        fitted, settings = self.result.stage, scene.facestage
        if lit_by_world(scene):
            return "A world lights the face"
        if softbox_of(settings.stage) is not None:
            return "A softbox lights the face"
        if len(stage) != len(fitted):
            return f"The stage has {len(stage)} lights, the result {len(fitted)}"
        for name in ("position", "direction", "axis_x", "side"):
            offset = (
                np.abs(getattr(stage, name) - getattr(fitted, name))
                .reshape(len(stage), -1)
                .max(axis=1)
            )
            if offset.max() > TOLERANCE:
                return f"Light {int(offset.argmax()) + 1} was moved, turned or resized"
        if settings.rig is not None and settings.rig.name in scene.objects:
            head = frames.to_stage_matrix(
                relative_matrix(settings.stage, settings.rig), rig_axes(settings.rig)
            )
            if not np.allclose(head, self.result.model_to_stage, atol=TOLERANCE):
                return "The head was moved"
            if not self._same_sliders(settings.rig):
                return "A slider was moved"
        return "" if self._same_camera(scene) else "The camera was moved or has another lens"

    def _same_sliders(self, rig: bpy.types.Object) -> bool:
        for shown, fitted in zip(
            read_weights(rig), (self.result.identity, self.result.expression), strict=True
        ):
            values = np.array(list(shown.values()))
            wanted = np.clip(fitted, -SLIDER_LIMIT, SLIDER_LIMIT)
            if values.shape != wanted.shape or not np.allclose(values, wanted, atol=TOLERANCE):
                return False
        own = OwnMesh.of(rig)
        if own is not None and own.borrowed:
            return True  # it is part of the shape that was borrowed
        return shown_relief(rig) == float(self.result.relief is not None)

    def _same_camera(self, scene: bpy.types.Scene) -> bool:
        if scene.camera is None or scene.camera.data.type != "PERSP":
            return False
        local = relative_matrix(scene.facestage.stage, scene.camera)
        local[:3, :3] /= np.linalg.norm(local[:3, :3], axis=0)
        fitted = self.result.camera
        camera = read_camera(scene.camera.data, fitted.width, fitted.height)
        return bool(
            np.allclose(
                frames.to_stage_matrix(local, frames.CAMERA),
                self.result.camera_to_stage,
                atol=TOLERANCE,
            )
            and np.isclose(camera.focal_px, fitted.focal_px, rtol=TOLERANCE)
            and np.allclose(camera.principal_px, fitted.principal_px, atol=TOLERANCE * fitted.width)
        )


def changed_at(folder: Path) -> int:
    """When the relight cache of a result was written, ns; 0 when there is none."""
    try:
        return (folder / RELIGHT_CACHE).stat().st_mtime_ns
    except OSError:
        return 0


def _photo_pixels(path: str, width: int, height: int) -> np.ndarray | None:
    """(h w, 4) linear RGBA of the photo at another size, its nearest pixels; None without a
    readable photo: the face itself needs none.
    """
    try:
        image = load_image(absolute(path)) if path else None
    except InputError:
        image = None
    if image is None:
        return None
    photo = image_pixels(image)[::-1, :, :3]
    y = ((np.arange(height) + 0.5) * len(photo) / height).astype(int)
    x = ((np.arange(width) + 0.5) * photo.shape[1] / width).astype(int)
    photo = photo[y[:, None], x]
    pixels = np.ones((height, width, 4), np.float32)
    pixels[..., :3] = photo if image.is_float else srgb_to_linear(photo)
    return pixels.reshape(-1, 4)
