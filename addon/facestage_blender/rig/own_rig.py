"""Makes a mesh of the user's the scene's face rig, and writes what no slider of theirs can say."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np

from facestage.contract.errors import InputError
from facestage.contract.face_model import OTHER, PARTS, FaceModel
from facestage.contract.result import Result
from facestage.contract.rig_file import RigFile

from ..scene.several import separate_light
from ..skin.material import GROUP, paint_albedo, part_materials, show_model
from .certainty import remember_region
from .landmark_points import remember_landmarks
from .own_marks import slot_parts, veils_eyes
from .own_mesh import model_frame, read_mesh
from .own_record import OwnMesh
from .own_sliders import read_shapes

TILT_MAX = 45.0  # degrees of a head that stands in the scene
OFFSET_MAX = 1e12  # units of the mesh; beyond, single floats end


def export_mesh(
    item: bpy.types.Object | None, folder: Path
) -> tuple[Path, RigFile, OwnMesh, list[str]]:
    """Write the object's mesh into ``folder`` for the backend: the file of ``rig:FILE``, and what
    :func:`adopt` needs.

    Must run in object mode. Raises InputError when the object cannot be a face.
    """
    if (
        item is not None
        and item.type == "MESH"
        and item.facestage_face.is_rig
        and not item.facestage_face.own_mesh
    ):
        raise InputError(
            f"'{item.name}' was built by Facestage and is a face rig already; choose a mesh of "
            "your own."
        )
    rig, own, notes = read_mesh(item)
    path = folder / f"{bpy.path.clean_name(rig.name)}.rig.npz"
    rig.save(path)
    return path, rig, own, notes


def adopt(
    scene: bpy.types.Scene,
    item: bpy.types.Object,
    spec: str,
    model: FaceModel,
    rig: RigFile,
    own: OwnMesh,
    albedo: np.ndarray | None = None,
) -> None:
    """Make the object the scene's rig for the model that the backend made of it; nothing is moved
    yet.

    With the object's "Facestage Skin" the materials of face, eyes and mouth give way to
    Facestage's; the user's stay in the file. ``albedo``: of :func:`..skin.material.paint_albedo`
    for this model; without it, it is painted here where it is needed.

    Raises InputError before anything changes where nothing was marked and the face that was found
    does not stand upright: then it is none.
    """
    to_model = model_frame(rig, model)
    if not rig.marks:
        _check_upright(item, to_model)
    own.to_model = to_model.tolist()
    own.borrowed = {} if own.identity else dict.fromkeys(model.identity_names, 0.0)
    own.store(item)
    face = item.facestage_face
    face.is_rig, face.model = True, spec
    remember_landmarks(item.data, model)
    remember_region(item.data, model)
    scene.facestage.rig, scene.facestage.model = item, spec
    separate_light(scene)
    if not face.own_materials:
        return
    _replace_materials(item, own.uv_layer)
    show_model(item, paint_albedo(model) if albedo is None else albedo)


def check_vertices(rig: bpy.types.Object, result: Result) -> None:
    """Raise InputError when the mesh was edited since the result was made."""
    if len(rig.data.vertices) != len(result.vertices):
        raise InputError(
            f"The mesh '{rig.name}' has {len(rig.data.vertices)} vertices, the result "
            f"{len(result.vertices)}; press Use My Mesh and fit again."
        )


def borrowed_shape(rig: bpy.types.Object, own: OwnMesh, result: Result) -> np.ndarray | None:
    """(n, 3) the part of the fitted shape that the mesh has no sliders for, in its own coordinates;
    None without any.

    Raises InputError when the mesh's shape keys cannot carry it.
    """
    if own.identity or not result.identity_names:
        return None
    model = (result.vertices - result.model_to_camera[:3, 3]) @ result.model_to_camera[:3, :3]
    back = np.linalg.inv(own.matrix)
    fitted = model @ back[:3, :3].T + back[:3, 3]
    base, _, offsets, shapes, _ = read_shapes(rig)
    weights = dict(zip(result.expression_names, result.expression.tolist(), strict=True))
    shown = np.array([weights.get(name, 0.0) for name in shapes.expression])
    rest: np.ndarray = fitted - base - np.tensordot(shown, offsets, 1)
    if not np.isfinite(rest).all() or np.abs(rest).max() > OFFSET_MAX:
        raise InputError(
            f"The result's face is too far from the mesh '{rig.name}'; press Use My Mesh and "
            "fit again."
        )
    return rest


def _check_upright(item: bpy.types.Object, to_model: np.ndarray) -> None:
    """Raise InputError where the crown of the face that was found points elsewhere than up."""
    turn = np.linalg.inv(np.array(item.matrix_world.to_3x3(), np.float64))
    up = to_model[:3, :3] @ turn @ [0.0, 0.0, 1.0]
    tilt = float(np.degrees(np.arccos(np.clip(up[1] / np.linalg.norm(up), -1, 1))))
    if tilt > TILT_MAX:
        raise InputError(
            f"The face that was found on '{item.name}' does not look like one from the front: its "
            f"crown is {tilt:.0f} degrees off upright. If it is a face, turn it so that it stands "
            "(crown along Z) or mark some landmarks (eye corners, nose tip, mouth corners, chin)."
        )


def _replace_materials(item: bpy.types.Object, uv_layer: str) -> None:
    """Give every slot that the fit colors Facestage's material of its part, and what would hide the
    eyes one that is seen through; the user's are kept in the file.
    """
    if not item.material_slots:
        item.data.materials.append(None)
    for slot, part in zip(item.material_slots, slot_parts(item), strict=True):
        old = slot.material
        if part == OTHER:
            if old is None or not veils_eyes(old):
                continue
        elif old is not None and old.node_tree is not None and GROUP in old.node_tree.nodes:
            continue
        fresh = part_materials(np.array([part if part < len(PARTS) else 0]), uv_layer)[0]
        fresh.facestage_part = PARTS[part].upper() if part < len(PARTS) else "AUTO"
        if old is not None:
            old.use_fake_user = True
        slot.material = fresh
