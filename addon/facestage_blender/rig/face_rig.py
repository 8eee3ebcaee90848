"""The face rig: a mesh with shape keys, UVs, materials and vertex groups, from the contract's
FaceModel.
"""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.errors import InputError
from facestage.contract.face_model import FaceModel

from ..scene import frames
from ..scene.color_views import follow_marks
from ..scene.several import separate_light
from ..scene.stage import facestage_collection, relative_matrix, require_stage
from ..skin.brows import renew_brows
from ..skin.lashes import renew_lashes
from ..skin.lids import remember_lids
from ..skin.material import paint_albedo, part_materials, show_model
from ..skin.wet_eyes import renew_wet_eyes
from . import relief_key
from .landmark_points import remember_landmarks
from .own_record import OwnMesh
from .own_sliders import own_slider_values, read_own_weights
from .sliders import set_slider, widen

NAME = "Facestage Face"
IDENTITY = "identity/"
SLIDER_RANGE = 5.0  # standard deviations
SLIDER_LIMIT = 10.0  # Blender's own
NAME_LENGTH = 63  # bytes of a name in Blender


def build_rig(
    scene: bpy.types.Scene,
    model: FaceModel,
    spec: str,
    stage: bpy.types.Object,
    albedo: np.ndarray | None = None,
) -> bpy.types.Object:
    """Build the rig of ``model`` under the stage's empty, or rebuild the scene's present one in
    place.

    A mesh of the user's that serves as the rig is left alone.

    ``spec`` is what the backend calls the model ("default", "ict:PATH", ...). ``albedo``: of
    :func:`..skin.material.paint_albedo` for this model; without it, it is painted here.
    """
    rig = scene.facestage.rig
    mesh = build_mesh(model)
    retired = None
    if rig is None or rig.name not in scene.objects or rig.facestage_face.own_mesh:
        rig = bpy.data.objects.new(NAME, mesh)
        facestage_collection(scene).objects.link(rig)
        scene.facestage.rig = rig
        rig.parent = stage
        rig.matrix_parent_inverse = Matrix()
    else:
        retired, rig.data = rig.data, mesh
        rig.vertex_groups.clear()
    rig.facestage_face.is_rig, rig.facestage_face.model = True, spec
    add_shape_keys(rig, model)
    for name, vertices in model.regions.items():
        rig.vertex_groups.new(name=name).add(vertices.tolist(), 1.0, "REPLACE")
    if retired is not None:
        _remove_mesh(retired)
        follow_marks()
    show_model(rig, paint_albedo(model) if albedo is None else albedo)
    remember_lids(mesh, model)
    remember_landmarks(mesh, model)
    renew_lashes(rig)
    renew_brows(rig)
    renew_wet_eyes(rig)
    separate_light(scene)
    return rig


def build_mesh(model: FaceModel) -> bpy.types.Mesh:
    """The mean face as a mesh in Blender's axes, with quads, UVs, smooth shading and a material for
    each part.
    """
    mesh = bpy.data.meshes.new(NAME)
    corners = 3 + (model.polygons[:, 3] >= 0).astype(np.int32)
    used = np.arange(4) < corners[:, None]
    mesh.vertices.add(len(model.vertices))
    mesh.vertices.foreach_set("co", _blender_points(model.vertices))
    mesh.loops.add(int(corners.sum()))
    mesh.loops.foreach_set("vertex_index", np.ascontiguousarray(model.polygons[used]))
    mesh.polygons.add(len(corners))
    mesh.polygons.foreach_set(
        "loop_start", np.concatenate([[0], np.cumsum(corners)[:-1]]).astype(np.int32)
    )
    uv = mesh.uv_layers.new(name="UVMap", do_init=False)
    parts = np.unique(model.polygon_part)
    mesh.polygons.foreach_set(
        "material_index", np.searchsorted(parts, model.polygon_part).astype(np.int32)
    )
    mesh.update(calc_edges=True)
    uv.uv.foreach_set(
        "vector", np.ascontiguousarray(model.uvs[model.polygon_uvs[used]], np.float32).ravel()
    )
    mesh.shade_smooth()
    for material in part_materials(parts):
        mesh.materials.append(material)
    mesh["facestage_license"] = model.license
    mesh["facestage_source"] = model.source
    return mesh


def add_shape_keys(rig: bpy.types.Object, model: FaceModel) -> None:
    """Add Basis, one key for each identity mode and one for each expression, to a mesh without
    keys.
    """
    rig.shape_key_add(name="Basis", from_mix=False)
    basis = _blender_points(model.vertices)
    gaussian = np.zeros(len(model.identity_names), bool)
    groups = (
        (IDENTITY, model.identity_names, model.identity_basis, gaussian),
        ("", model.expression_names, model.expression_basis, model.expression_box),
    )
    for prefix, names, offsets, boxes in groups:
        for name, offset, box in zip(names, offsets, boxes, strict=True):
            low, high = (0.0, 1.0) if box else (-SLIDER_RANGE, SLIDER_RANGE)
            key = rig.shape_key_add(name=key_name(prefix + name), from_mix=False)
            # Blender 4.1 and later have the same as plain points, far faster.
            points = getattr(key, "points", key.data)
            points.foreach_set("co", basis + _blender_points(offset))
            key.slider_min, key.slider_max, key.value = low, high, 0.0
    rig.data.shape_keys.name = NAME


def require_rig(scene: bpy.types.Scene) -> bpy.types.Object:
    """The scene's rig. Raises InputError when there is none or its shape keys are gone."""
    rig = scene.facestage.rig
    if rig is None or rig.name not in scene.objects or not rig.facestage_face.is_rig:
        raise InputError("The scene has no face rig; press Build Face Rig first.")
    if rig.data.shape_keys is None and not rig.facestage_face.own_mesh:
        raise InputError(
            f"The face rig '{rig.name}' has lost its shape keys; press Build Face Rig again."
        )
    return rig


def key_name(name: str) -> str:
    """A name as Blender stores it."""
    return name.encode()[:NAME_LENGTH].decode(errors="ignore")


def read_weights(rig: bpy.types.Object) -> tuple[dict[str, float], dict[str, float]]:
    """Identity and expression weights by name, as the sliders show them."""
    own = OwnMesh.of(rig)
    if own is not None:
        return read_own_weights(rig, own)
    keys = list(rig.data.shape_keys.key_blocks)[1:]
    values = {key.name: float(key.value) for key in keys if key.name != relief_key.NAME}
    identity = {
        name[len(IDENTITY) :]: value for name, value in values.items() if name.startswith(IDENTITY)
    }
    return identity, {
        name: value for name, value in values.items() if not name.startswith(IDENTITY)
    }


def set_weights(
    rig: bpy.types.Object, identity: dict[str, float], expression: dict[str, float]
) -> None:
    """Move the sliders to the given weights. Raises InputError for a name the rig does not have."""
    move_sliders(rig, slider_values(rig, identity, expression))


def slider_values(
    rig: bpy.types.Object, identity: dict[str, float], expression: dict[str, float]
) -> dict[str, float]:
    """Shape key -> its value for the given weights.

    Raises InputError for a name the rig does not have.
    """
    own = OwnMesh.of(rig)
    if own is not None:
        return own_slider_values(rig, own, identity, expression)
    keys = rig.data.shape_keys.key_blocks
    wanted = {key_name(IDENTITY + name): value for name, value in identity.items()}
    wanted |= {key_name(name): value for name, value in expression.items()}
    missing = [name for name in wanted if name not in keys]
    if missing:
        raise InputError(
            f"The face rig '{rig.name}' has no shape key '{missing[0]}' ({len(missing)} of "
            f"{len(wanted)} are missing); build the rig of the same face model."
        )
    return {
        name: min(max(float(value), -SLIDER_LIMIT), SLIDER_LIMIT) for name, value in wanted.items()
    }


def move_sliders(rig: bpy.types.Object, values: dict[str, float]) -> None:
    """Set shape keys that there are; a slider becomes as long as its value needs."""
    for name, value in values.items():
        key = rig.data.shape_keys.key_blocks[name]
        widen(key, value, value)
        set_slider(key, value)


def rig_axes(rig: bpy.types.Object) -> str | np.ndarray:
    """What :mod:`.frames` must know of the axes that the rig's own coordinates have."""
    own = OwnMesh.of(rig)
    return frames.STAGE if own is None else own.matrix


def head_yaw(scene: bpy.types.Scene) -> float:
    """Radians by which the scene's face, as it is posed, looks to the right of where the stage's
    camera is; 0 where there is none.
    """
    rig = scene.facestage.rig
    if rig is None or rig.name not in scene.objects:
        return 0.0
    local = relative_matrix(require_stage(scene), rig)
    x, _, z = frames.to_stage_matrix(local, rig_axes(rig))[:3, 2]
    return math.atan2(x, z)


def relief_of(rig: bpy.types.Object, relief: np.ndarray) -> np.ndarray:
    """(n, 3) ``relief`` (n, 3), metres in the model's frame, in the mesh's own coordinates."""
    own = OwnMesh.of(rig)
    if own is None:
        return frames.points_to_blender(relief)
    turned: np.ndarray = relief @ np.linalg.inv(own.matrix)[:3, :3].T
    return turned


def _blender_points(points: np.ndarray) -> np.ndarray:
    """Flat float32 coordinates in Blender's axes, for foreach_set."""
    return np.ascontiguousarray(frames.points_to_blender(points), np.float32).ravel()


def _remove_mesh(mesh: bpy.types.Mesh) -> None:
    """Remove a mesh that nothing uses, with its own materials."""
    if mesh.users:
        return
    materials = [material for material in mesh.materials if material is not None]
    bpy.data.meshes.remove(mesh)
    for material in materials:
        if not material.users:
            bpy.data.materials.remove(material)
