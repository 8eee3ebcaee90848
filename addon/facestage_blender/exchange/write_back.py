"""The only writer: a Result becomes sliders, pose, textures, lights and camera.

The world is not touched.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.certainty import DEVIATION
from facestage.contract.errors import InputError
from facestage.contract.result import Result
from facestage.contract.texture_maps import FOLD_MAP, PLAIN

from ..rig.certainty import write_certainty
from ..rig.control.control_rig import renewal_steps
from ..rig.face_rig import key_name, move_sliders, relief_of, require_rig, rig_axes, slider_values
from ..rig.own_lines import remove_lines
from ..rig.own_record import OwnMesh
from ..rig.own_rig import borrowed_shape, check_vertices
from ..rig.own_sliders import write_shape
from ..rig.relief_key import check_relief, write_relief
from ..rig.sliders import carrier, value_path
from ..scene import frames
from ..scene.camera import ensure_camera, write_camera
from ..scene.color_views import show_new_skin
from ..scene.own_view import return_to_photo
from ..scene.relight import take_back
from ..scene.several import separate_light, shares_camera
from ..scene.stage import build_stage, facestage_collection, place, require_stage
from ..skin.brows import renew_brows
from ..skin.displaced_skin import displace
from ..skin.folds import give_folds, take_folds
from ..skin.lashes import color_lashes
from ..skin.material import set_scattering, set_textures
from ..skin.uneven_skin import set_curvature
from ..skin.wet_eyes import keep_wet
from .result_textures import loading_steps


def apply_result(scene: bpy.types.Scene, result: Result) -> None:
    """Write the fitted face, lights and camera into the scene.

    With the scene's "Keep Camera" the camera stays and only the head moves; where another face was
    fitted in the same camera's picture, the stage moves in the camera's place. Raises InputError
    before anything changes when the rig is of another model, or something of the result or the
    scene does not fit.
    """
    for _ in apply_steps(scene, result):
        pass


def apply_steps(scene: bpy.types.Scene, result: Result) -> Iterator[None]:
    """:func:`apply_result` in steps, so that the window is never held for long: the pictures, the
    scene, the handles.
    """
    shape = _checked(scene, result)
    textures = yield from loading_steps(result)
    _write_shape(scene, result, shape)
    yield
    _write_skin(scene, result, textures)
    yield
    write_certainty(require_rig(scene), result.arrays.get(DEVIATION))
    show_new_skin(require_rig(scene).data)
    yield
    yield from renewal_steps(scene)


@dataclass(frozen=True)
class _Shape:
    """What the rig is made to show."""

    sliders: dict[str, float]
    identity: dict[str, float]
    borrowed: np.ndarray | None  # (n, 3) that a mesh's sliders lack, in its own coordinates
    relief: np.ndarray | None  # (n, 3), likewise


def _checked(scene: bpy.types.Scene, result: Result) -> _Shape:
    """Raises InputError when the result or the scene does not fit; nothing is changed."""
    require_stage(scene)
    rig = require_rig(scene)
    if rig.facestage_face.model != result.model:
        raise InputError(
            f"The result is of the face model '{result.model}', the rig of "
            f"'{rig.facestage_face.model}'; build the rig of the result's model first."
        )
    keep_camera = scene.facestage.keep_camera
    if not keep_camera and scene.camera is not None and scene.camera.type != "CAMERA":
        raise InputError(
            f"'{scene.camera.name}' serves as the scene's camera and is none; choose a camera."
        )
    own = OwnMesh.of(rig)
    identity = dict(zip(result.identity_names, result.identity.tolist(), strict=True))
    expression = dict(zip(result.expression_names, result.expression.tolist(), strict=True))
    sliders, borrowed = slider_values(rig, identity, expression), None
    if own is not None:
        check_vertices(rig, result)
        borrowed = borrowed_shape(rig, own, result)
    # What a mesh borrows is the whole of the shape that its sliders lack.
    relief = result.relief if borrowed is None else None
    if relief is not None:
        check_relief(rig, relief)
        relief = relief_of(rig, relief)
    return _Shape(sliders, identity, borrowed, relief)


def _write_shape(scene: bpy.types.Scene, result: Result, shape: _Shape) -> None:
    """Sliders, relief, lights, pose and camera."""
    settings = scene.facestage
    empty, rig = require_stage(scene), require_rig(scene)
    moves_stage = not settings.keep_camera and shares_camera(scene)
    move_sliders(rig, shape.sliders)
    remove_lines(rig)
    own = OwnMesh.of(rig)
    if own is not None and shape.borrowed is not None:
        write_shape(rig, own, shape.identity, shape.borrowed)
    write_relief(rig, shape.relief)
    take_back(scene)
    build_stage(scene, result.stage)
    if moves_stage:
        _put_before(scene.camera, empty, result)
    place(empty, carrier(rig), result.model_to_stage, rig_axes(rig))
    if not settings.keep_camera and not moves_stage:
        return_to_photo(scene)
        camera = ensure_camera(scene, facestage_collection(scene))
        place(empty, camera, result.camera_to_stage, frames.CAMERA)
        write_camera(scene, camera.data, result.camera)
    if result.folder is not None:
        settings.result = str(result.folder)
    for layer in scene.view_layers:
        layer.update()


def _write_skin(
    scene: bpy.types.Scene, result: Result, textures: dict[str, bpy.types.Image]
) -> None:
    """Textures, what light does in the skin, and what grows on it."""
    rig = require_rig(scene)
    take_folds(rig)  # an older result's, whose picture goes
    set_textures(rig, textures, {name: float(result.parameters[name]) for name in PLAIN})
    keys = rig.data.shape_keys.key_blocks
    sliders = [keys.get(key_name(name)) for name in result.expression_names]
    paths = [None if key is None else value_path(key) for key in sliders]
    give_folds(rig, textures.get(FOLD_MAP.name), result.folds, paths)
    displace(rig, False)  # another relief: by its normal map until it is asked for
    scattering, translucency = (
        float(result.parameters.get(name, 0.0)) for name in ("scattering", "translucency")
    )
    set_scattering(rig, scattering, translucency)
    # EEVEE, which only blurs, is as uneven where light scatters too.
    uneven = scattering > 0 or translucency > 0
    set_curvature(rig, result.vertices if uneven else None)
    color_lashes(rig)
    renew_brows(rig)
    keep_wet(rig)
    separate_light(scene)
    for layer in scene.view_layers:
        layer.update()


def _put_before(camera: bpy.types.Object, empty: bpy.types.Object, result: Result) -> None:
    """Move the stage to where the camera, which stays, sees it as the fit had it."""
    seen = Matrix(frames.local_matrix(result.camera_to_stage, frames.CAMERA).tolist())
    where, turn, _ = camera.matrix_world.decompose()
    empty.matrix_world = Matrix.LocRotScale(where, turn, None) @ seen.inverted()
    bpy.context.view_layer.update()
