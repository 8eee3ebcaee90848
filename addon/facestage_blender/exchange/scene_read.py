"""The only reader: what the user has set up in the scene, as the contract's Job."""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.job import KNOWN, UNKNOWN, Job, Weights

from ..landmarks.editing import file_landmarks, read_landmarks
from ..pictures.images import load_image
from ..pins.record import photo_pins
from ..properties import PhotoSettings
from ..rig.face_rig import read_weights, require_rig, rig_axes
from ..scene import frames
from ..scene.camera import read_camera, require_camera
from ..scene.paths import absolute, require_photo
from ..scene.several import shares_camera
from ..scene.stage import read_stage, relative_matrix, require_stage
from .photos import stored_photos


def read_jobs(scene: bpy.types.Scene) -> list[Job]:
    """The jobs of all photos of the person. Raises InputError as :func:`read_job` does."""
    listed, shown = stored_photos(scene), scene.facestage.photo_number
    return [
        read_job(scene) if number == shown else read_job(scene, photo)
        for number, photo in enumerate(listed, 1)
    ] or [read_job(scene)]


def read_job(scene: bpy.types.Scene, photo: PhotoSettings | None = None) -> Job:
    """The scene's job for the photo that is shown, or for another one of the list.

    Raises InputError naming what is missing or wrong and what to do.
    """
    settings = scene.facestage
    given = settings if photo is None else photo
    path = require_photo(scene) if photo is None else absolute(photo.photo)
    width, height = load_image(path).size
    empty, rig = require_stage(scene), require_rig(scene)
    frozen = tuple(sorted(settings.freeze))
    camera = camera_to_stage = None
    if settings.keep_camera or given.known_lens or "focal" in frozen or shares_camera(scene):
        lens = require_camera(scene).data if photo is None else photo
        camera = read_camera(lens, width, height)
    if settings.keep_camera:
        camera_to_stage = read_camera_to_stage(scene)
    if photo is None:
        landmarks = read_landmarks(scene, width, height)
    else:
        landmarks = file_landmarks(photo.landmarks, width, height)
    return Job(
        image=path,
        model=rig.facestage_face.model,
        landmarks=landmarks,
        face=given.face_number if landmarks is None else None,
        camera=camera,
        stage=read_stage(empty),
        camera_to_stage=camera_to_stage,
        light_color=settings.light_color,
        surround=settings.surround,
        exposure=KNOWN if settings.exposure_known else UNKNOWN,
        white_balance=tuple(given.white_balance) if given.white_balance_known else None,
        skin_tone=settings.known_skin_tone(),
        freeze=frozen,
        weights=Weights(
            photo=settings.weight_photo,
            landmarks=settings.weight_landmarks,
            prior=settings.weight_prior,
            light=settings.weight_light,
        ),
        initial=_initial(scene, frozen, camera_to_stage)
        | (_pinned(scene, camera is None) if photo is None and given.pins else {}),
        budget_seconds=settings.budget or None,
        quality=settings.quality,
        seed=settings.seed,
        device=settings.device,
        texture_size=int(settings.texture_size) or None,
        pins=photo_pins(given, rig),
    )


def read_camera_to_stage(scene: bpy.types.Scene) -> np.ndarray:
    """(4, 4) pose of the scene's camera in the stage frame, without its scale."""
    local = relative_matrix(require_stage(scene), require_camera(scene))
    local[:3, :3] /= np.linalg.norm(local[:3, :3], axis=0)
    return frames.to_stage_matrix(local, frames.CAMERA)


def read_model_to_stage(scene: bpy.types.Scene) -> np.ndarray:
    """(4, 4) pose of the rig in the stage frame."""
    rig = require_rig(scene)
    matrix = frames.to_stage_matrix(relative_matrix(require_stage(scene), rig), rig_axes(rig))
    # a mesh of the user's may have been scaled since
    matrix[:3, :3] /= np.cbrt(np.linalg.det(matrix[:3, :3]))
    return matrix


def _initial(
    scene: bpy.types.Scene, frozen: tuple[str, ...], camera_to_stage: np.ndarray | None
) -> dict[str, np.ndarray]:
    """Where the fit starts: what is frozen must be said, the rest only when the user asks for
    it.
    """
    settings, rig = scene.facestage, require_rig(scene)
    identity, expression = read_weights(rig)
    values: dict[str, np.ndarray] = {}
    for name, weights in (("identity", identity), ("expression", expression)):
        if settings.start_from_rig or name in frozen:
            values[name] = np.array(list(weights.values()), np.float64)
    if settings.start_from_rig or "roughness" in frozen:
        values["roughness"] = np.array(rig.facestage_face.roughness)
    if camera_to_stage is not None and (settings.start_from_rig or "pose" in frozen):
        values["model_to_camera"] = np.linalg.inv(camera_to_stage) @ read_model_to_stage(scene)
    return values


def _pinned(scene: bpy.types.Scene, finds_focal: bool) -> dict[str, np.ndarray]:
    """A face that was pinned is where the fit of its photo starts: as it stands in the camera."""
    if scene.facestage.photos:  # whose other photos start elsewhere, with another identity
        return {}
    lens = require_camera(scene)
    width, height = load_image(require_photo(scene)).size
    identity, expression = (
        np.array(list(each.values())) for each in read_weights(require_rig(scene))
    )
    pose = np.linalg.inv(read_camera_to_stage(scene)) @ read_model_to_stage(scene)
    found = {"identity": identity, "expression": expression, "model_to_camera": pose}
    if finds_focal:
        found["focal_px"] = np.array(read_camera(lens.data, width, height).focal_px)
    return found
