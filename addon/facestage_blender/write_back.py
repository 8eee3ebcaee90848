"""The only writer: a Result becomes sliders, pose, textures, lights and camera. The world is not touched."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.errors import InputError
from facestage.contract.result import ROUGHNESS, Result

from . import frames
from .camera import ensure_camera, write_camera
from .material import set_textures
from .own_mesh import OwnMesh
from .own_rig import check_vertices, write_borrowed_shape
from .rig import require_rig, rig_axes, set_weights
from .stage import build_stage, facestage_collection, require_stage


def apply_result(scene: bpy.types.Scene, result: Result) -> None:
    """Write the fitted face, lights and camera into the scene.

    With the scene's "Keep camera" the camera stays and only the head moves. Raises InputError before
    anything changes when the rig is of another model or a picture is missing.
    """
    settings = scene.facestage
    empty, rig = require_stage(scene), require_rig(scene)
    if rig.facestage_face.model != result.model:
        raise InputError(
            f"The result is of the face model '{result.model}', the rig of '{rig.facestage_face.model}'; "
            "build the rig of the result's model first."
        )
    own = OwnMesh.of(rig)
    if own is not None:
        check_vertices(rig, result)
    albedo, specular = load_texture(result, "albedo"), load_texture(result, "specular")
    has_map = (Path(result.folder or "") / ROUGHNESS).is_file()  # older results have one value alone
    roughness = load_texture(result, Path(ROUGHNESS).stem) if has_map else None
    set_weights(rig, dict(zip(result.identity_names, result.identity.tolist(), strict=True)),
                dict(zip(result.expression_names, result.expression.tolist(), strict=True)))  # fmt: skip
    if own is not None:
        write_borrowed_shape(rig, own, result)
    build_stage(scene, result.stage)
    place(empty, rig, result.model_to_stage, rig_axes(rig))
    set_textures(rig, albedo, specular, result.roughness, roughness)
    if not settings.keep_camera:
        camera = ensure_camera(scene, facestage_collection(scene))
        place(empty, camera, result.camera_to_stage, frames.CAMERA)
        write_camera(scene, camera.data, result.camera)
    if result.folder is not None:
        settings.result = str(result.folder)
    for layer in scene.view_layers:
        layer.update()


def place(empty: bpy.types.Object, item: bpy.types.Object, to_stage: np.ndarray, axes: str | np.ndarray) -> None:
    """Move an object to its pose (4, 4) in the stage frame, whatever its parent is; it takes the axes' scale."""
    item.matrix_world = empty.matrix_world @ Matrix(frames.local_matrix(to_stage, axes).tolist())


def load_texture(result: Result, name: str) -> bpy.types.Image:
    """The result's NAME.exr as an image packed into the .blend, never color-converted."""
    path = Path(result.folder or "") / f"{name}.exr"
    if result.folder is None or not path.is_file():
        raise InputError(f"The result has no '{path}'; run the fit again.")
    try:
        image = bpy.data.images.load(str(path))
    except RuntimeError as error:
        raise InputError(f"The result's picture '{path}' cannot be read; run the fit again.") from error
    image.name = f"Facestage {name.capitalize()}"
    image.colorspace_settings.name = "Non-Color"
    image.alpha_mode = "NONE"
    image.pack()
    return image
