"""The fitted face for other programs: one file that glTF, FBX, USD or OBJ readers understand.

Blender's exporters do not look into node groups, and 80 sliders of who somebody is are of no use
elsewhere: what is exported is a copy of the rig with its identity as its shape, its expressions as
shape keys under their own names, and plain materials with 8-bit pictures.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from facestage.contract.errors import InputError
from facestage.contract.face_model import OTHER, PARTS

from ..pictures.render import quiet
from ..rig.certainty import leave_out
from ..rig.face_rig import IDENTITY, require_rig
from ..rig.own_record import OwnMesh
from ..rig.own_sliders import SHAPE_KEY
from ..rig.relief_key import NAME as RELIEF_KEY
from ..rig.sliders import is_bound
from ..scene.user_state import preserved
from ..skin.plain_eyes import plain_eyes, shows_eyes, spread_uvs, write_eyes
from ..skin.plain_skin import is_facestage_skin, plain_skin, write_textures

SIDE_MIN = 16
NAME = "Face"  # as other programs call it


@dataclass(frozen=True)
class Format:
    """A kind of file, and how Blender writes it."""

    title: str
    suffix: str
    operator: str  # module.name in bpy.ops
    options: Mapping[str, Any]
    embeds: bool  # whether the file holds the textures itself


FORMATS = {
    "GLB": Format(
        "glTF Binary",
        ".glb",
        "export_scene.gltf",
        {
            "export_format": "GLB",
            "use_selection": True,
            "export_morph": True,
            "export_animations": False,
        },
        embeds=True,
    ),
    "FBX": Format(
        "FBX",
        ".fbx",
        "export_scene.fbx",
        {
            "use_selection": True,
            "use_mesh_modifiers": False,  # with them shape keys are lost
            "bake_anim": False,
            "path_mode": "COPY",
            "embed_textures": True,
        },
        embeds=True,
    ),
    "USD": Format(
        "USD",
        ".usdc",
        "wm.usd_export",
        {
            "selected_objects_only": True,
            "export_materials": True,
            "generate_preview_surface": True,
            "export_textures": False,
            "export_textures_mode": "KEEP",
            "relative_paths": True,
            "export_shapekeys": True,
            "export_animation": False,
            "convert_world_material": False,
        },
        embeds=False,
    ),
    "OBJ": Format(
        "OBJ, Without Sliders",
        ".obj",
        "wm.obj_export",
        {
            "export_selected_objects": True,
            "apply_modifiers": True,  # which applies shape keys, too
            "export_materials": True,
            "path_mode": "RELATIVE",
        },
        embeds=False,
    ),
}


def export_face(
    scene: bpy.types.Scene, path: Path, side: int | None = None, in_place: bool = False
) -> list[Path]:
    """Write the scene's face to ``path``, whose ending says how; returns the files.

    Textures that the file cannot hold go into the folder NAME_textures beside it. ``side``: the
    most pixels along a texture's side; ``in_place``: the head stands where it stands in the scene,
    else in the origin, upright. The scene stays as it is. Raises InputError.
    """
    rig = require_rig(scene)
    kind = format_of(path)
    run = _exporter(kind)
    if side is not None and side < SIDE_MIN:
        raise InputError(f"Textures of {side} pixels are too small; give at least {SIDE_MIN}.")
    path = path.resolve()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".facestage-export-") as folder:
            staged = Path(folder) / path.name
            pictures = staged.with_name(f"{path.stem}_textures")
            pictures.mkdir()
            textures = write_textures(rig, pictures, side) | write_eyes(rig, pictures, side)
            with preserved(scene.view_layers[0]), _copy(scene, rig, textures, in_place):
                _run(run, staged, kind)
            return _move(staged, pictures, path, kind)
    except OSError as error:
        raise InputError(
            f"Cannot write '{path}' ({error.strerror or error}); choose a folder that you may "
            "write to."
        ) from error


def format_of(path: Path) -> Format:
    """The format that a file's ending stands for. Raises InputError."""
    for kind in FORMATS.values():
        if path.suffix.lower() == kind.suffix:
            return kind
    known = ", ".join(kind.suffix for kind in FORMATS.values())
    raise InputError(
        f"Cannot export to '{path.name}'; expected a name that ends in one of {known}."
    )


def _exporter(kind: Format) -> Callable[..., set[str]]:
    """Blender's operator. Raises InputError when the add-on that has it is off."""
    module, _, name = kind.operator.partition(".")
    operator: Callable[..., set[str]] = getattr(getattr(bpy.ops, module), name)
    try:
        operator.get_rna_type()  # type: ignore[attr-defined]
    except KeyError as error:
        raise InputError(
            f"Blender's {kind.title} exporter is off; enable it in the preferences (Add-ons)."
        ) from error
    return operator


def _run(run: Callable[..., set[str]], path: Path, kind: Format) -> None:
    """Export the selection. Raises InputError with Blender's own words."""
    known = run.get_rna_type().properties.keys()  # type: ignore[attr-defined]
    options = {name: value for name, value in kind.options.items() if name in known}
    try:
        with quiet():
            run(filepath=str(path), **options)
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise InputError(f"Blender could not write {kind.title}: {reason}") from error
    if not path.is_file():
        raise InputError(f"Blender wrote no {kind.title} file; see its system console.")


def _move(staged: Path, pictures: Path, path: Path, kind: Format) -> list[Path]:
    """Put what was written in its place, the file itself last."""
    moved = []
    if not kind.embeds:
        place = path.with_name(pictures.name)
        place.mkdir(exist_ok=True)
        moved = [(each, place / each.name) for each in sorted(pictures.iterdir())]
    material = staged.with_suffix(".mtl")
    if material.is_file():
        moved.append((material, path.with_suffix(".mtl")))
    moved.append((staged, path))
    for source, target in moved:
        os.replace(source, target)
    return [target for _, target in reversed(moved)]


@contextmanager
def _copy(
    scene: bpy.types.Scene, rig: bpy.types.Object, textures: Mapping[str, Path], in_place: bool
) -> Iterator[None]:
    """The face as it is exported, the only selected object of the scene while the block runs."""
    before = {kind: set(getattr(bpy.data, kind)) for kind in ("materials", "images")}
    for layer in scene.view_layers:
        layer.update()  # a script may have moved the rig just now
    matrix = rig.matrix_world.copy()
    mesh = rig.data.copy()
    copy = bpy.data.objects.new(NAME, mesh)
    mesh.name = NAME
    try:
        scene.collection.objects.link(copy)
        copy.matrix_world = matrix if in_place else Matrix()
        leave_out(mesh)
        _bake_identity(rig, mesh)
        _dress(rig, mesh, textures)
        for layer in scene.view_layers:
            for item in layer.objects:
                item.select_set(item == copy, view_layer=layer)
            layer.objects.active = copy
            layer.update()
        yield
    finally:
        bpy.data.objects.remove(copy)
        bpy.data.meshes.remove(mesh)
        for kind, had in before.items():
            for item in set(getattr(bpy.data, kind)) - had:
                getattr(bpy.data, kind).remove(item)


def _bake_identity(rig: bpy.types.Object, mesh: bpy.types.Mesh) -> None:
    """Make the shape that the identity sliders show the basis, and take them away; expressions keep
    their names, their motion and their values.
    """
    if mesh.shape_keys is None:
        return
    _undrive(rig, mesh)
    own = OwnMesh.of(rig)
    who = {
        SHAPE_KEY,
        RELIEF_KEY,
        *(() if own is None else (key for key, _ in own.identity.values())),
    }
    blocks = mesh.shape_keys.key_blocks
    basis = _points(blocks[0])
    offset = np.zeros_like(basis)
    baked = [key for key in blocks[1:] if key.name in who or key.name.startswith(IDENTITY)]
    for key in baked:
        if not key.mute:
            offset += key.value * (_points(key) - _points(key.relative_key))
    for key in blocks:
        if key not in baked:
            key.data.foreach_set("co", (_points(key) + offset).ravel())
    mesh.vertices.foreach_set("co", (basis + offset).ravel())
    names = [key.name for key in baked]
    holder = next(item for item in bpy.data.objects if item.data == mesh)
    for name in names:
        holder.shape_key_remove(blocks[name])


def _undrive(rig: bpy.types.Object, mesh: bpy.types.Mesh) -> None:
    """Let the copy's shape keys stay as they are shown, with no control rig to move them."""
    shapes = mesh.shape_keys
    shown = {key.name: key.value for key in rig.data.shape_keys.key_blocks}
    shapes.animation_data_clear()
    for key in shapes.key_blocks:
        if is_bound(key):
            del shapes[key.name]
        key.value = shown[key.name]


def _points(key: bpy.types.ShapeKey) -> np.ndarray:
    points = np.empty(3 * len(key.data), np.float32)
    key.data.foreach_get("co", points)
    return points.reshape(-1, 3)


def _dress(rig: bpy.types.Object, mesh: bpy.types.Mesh, textures: Mapping[str, Path]) -> None:
    """Plain materials in the place of Facestage's, and no faces that nobody sees."""
    hidden = set()
    uv_map = next((layer.name for layer in mesh.uv_layers if layer.active_render), "")
    for index, material in enumerate(mesh.materials):
        if material is None:
            continue
        if material.name.startswith(f"Facestage {PARTS[OTHER].capitalize()}"):
            hidden.add(index)
        elif is_facestage_skin(material):
            name = material.name.removeprefix("Facestage ")
            if shows_eyes(material, textures):
                mesh.materials[index] = plain_eyes(name, rig, index, textures, uv_map)
                spread_uvs(mesh, index)
            else:
                mesh.materials[index] = plain_skin(name, rig, textures, uv_map)
    if hidden:
        import bmesh  # is there only after bpy

        shown = bmesh.new()
        shown.from_mesh(mesh)
        faces = [face for face in shown.faces if face.material_index in hidden]
        bmesh.ops.delete(shown, geom=faces, context="FACES")
        shown.to_mesh(mesh)
        shown.free()
        for index in sorted(hidden, reverse=True):
            mesh.materials.pop(index=index)
