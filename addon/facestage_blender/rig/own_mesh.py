"""A mesh of the user's as a face rig: read with its shape keys, and written back to without
changing what is theirs.

What Facestage must know of it later (which slider each shape of the model is, and where the model's
frame lies in the mesh) is kept on the object as JSON: :class:`OwnMesh`.
"""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass, field
from typing import Any

import bpy
import numpy as np
from marshmallow import ValidationError

from facestage.contract.errors import InputError
from facestage.contract.face_model import EYES, MOUTH, OTHER, PARTS, SKIN, TEETH, FaceModel
from facestage.contract.rig_file import MARKS, UNKNOWN_PART, RigFile
from facestage.contract.schemas.array_field import Array
from facestage.contract.schemas.fields import Checked, Number, Table, Text
from facestage.contract.schemas.schema import FileSchema, checked, decoded_meta

from .own_uvs import face_uvs

MARK_GROUP = "facestage/"
SHAPE_KEY = "Facestage Shape"
FACTOR_MAX = 1e9  # of numbers in a record
IDENTITY_SPREAD = 2.0  # standard deviations from rest to the end of an identity slider
# What a material's name says; the first that fits counts.
_PART_WORDS = (
    (
        OTHER,
        r"lash|brow|hair|beard|tear|cornea|occlusion|wet|cloth|shirt|glass|transparent|\bother\b",
    ),
    (EYES, r"eye(?!lid)|iris|sclera|pupil"),
    (TEETH, r"teeth|tooth|denture"),
    (MOUTH, r"mouth|gum|tongue|saliva"),
    (SKIN, r"skin|face|head|body"),
)


class _Slider(Checked):
    """A shape key, and its value where the shape that it is counts 1."""

    def __init__(self) -> None:
        super().__init__("a shape key and a number that is not 0")

    def _deserialize(
        self, value: Any, attr: str | None, data: Any, **kwargs: Any
    ) -> tuple[str, float]:
        if not isinstance(value, list) or len(value) != 2 or not isinstance(value[0], str):
            raise self.wrong(value)
        factor = Number(-FACTOR_MAX, FACTOR_MAX).deserialize(value[1])
        if factor is None or abs(factor) < 1 / FACTOR_MAX:
            raise self.wrong(value)
        return value[0], float(factor)


def _regular(matrix: np.ndarray) -> None:
    if abs(np.linalg.det(matrix[:3, :3])) < 1e-30 or not np.array_equal(matrix[3], [0, 0, 0, 1]):
        raise ValidationError("is no transform of a mesh")


class OwnMeshSchema(FileSchema):
    """The record as the .blend keeps it."""

    identity = Table(_Slider())
    expression = Table(_Slider())
    to_model = Array((4, 4), minimum=-FACTOR_MAX, maximum=FACTOR_MAX, validate=_regular)
    borrowed = Table(Number(-FACTOR_MAX, FACTOR_MAX), load_default=dict)
    uv_layer = Text(load_default="")


@dataclass
class OwnMesh:
    """What ties a user's mesh to its face model."""

    # identity shape -> shape key, and its value at one standard deviation
    identity: dict[str, tuple[str, float]]
    expression: dict[str, tuple[str, float]]  # expression -> shape key, and its value at weight 1
    # (4, 4) the mesh's coordinates -> the model frame
    to_model: list[list[float]] = field(default_factory=list)
    # identity mode of the default model -> fitted weight
    borrowed: dict[str, float] = field(default_factory=dict)
    uv_layer: str = ""

    @classmethod
    def of(cls, rig: bpy.types.Object) -> OwnMesh | None:
        """The object's record, or None for a rig that Facestage built."""
        text = rig.facestage_face.own_mesh
        if not text:
            return None
        subject, again = f"What '{rig.name}' keeps of its face model", "press Use My Mesh again"
        found = checked(OwnMeshSchema(), decoded_meta(text, subject, again), subject, again)
        return cls(**found | {"to_model": found["to_model"].tolist()})

    def store(self, rig: bpy.types.Object) -> None:
        """Keep the record on the object."""
        rig.facestage_face.own_mesh = json.dumps(asdict(self))

    @property
    def matrix(self) -> np.ndarray:
        """(4, 4) float64, from the mesh's own coordinates to the model frame."""
        return np.array(self.to_model, np.float64)


def read_mesh(item: bpy.types.Object | None) -> tuple[RigFile, OwnMesh, list[str]]:
    """The object's mesh for the backend, its sliders, and sentences on what was left out.

    Must run in object mode. A UV map named "Facestage" is added where the mesh's own cannot carry
    one texture. Raises InputError when the object is no mesh that can be a face.
    """
    if item is None or item.type != "MESH":
        raise InputError("No mesh is active; select the mesh of a face and make it active.")
    mesh = item.data
    if len(mesh.vertices) < 100 or len(mesh.polygons) < 100:
        raise InputError(
            f"The mesh '{item.name}' has {len(mesh.vertices)} vertices and "
            f"{len(mesh.polygons)} faces; a face needs at "
            "least 100 of each: make the mesh of a face active."
        )
    vertices, identity, expression, own, notes = read_shapes(item)
    layer, corner_uvs = face_uvs(item)
    own.uv_layer = layer
    polygons, corners, source = _quads_and_triangles(mesh)
    uvs, first = np.unique(np.round(corner_uvs, 6), axis=0, return_inverse=True)
    polygon_uvs = np.where(corners >= 0, first.ravel()[np.maximum(corners, 0)], -1).astype(np.int32)
    scale = item.matrix_world.to_scale()
    if min(abs(value) for value in scale) < 1e-9:
        raise InputError(f"The object '{item.name}' is scaled to nothing; reset its scale (Alt S).")
    rig = RigFile(
        name=item.name,
        license="yours",
        vertices=vertices,
        scale=(scale.x, scale.y, scale.z),
        polygons=polygons,
        polygon_uvs=polygon_uvs,
        polygon_part=_parts(item)[source],
        uvs=uvs.astype(np.float32),
        expression_names=tuple(own.expression),
        expression_offsets=expression,
        identity_names=tuple(own.identity),
        identity_offsets=identity,
        borrow_identity=item.facestage_face.fit_shape,
        marks=read_marks(item),
    )
    return rig, own, notes


def read_shapes(
    item: bpy.types.Object,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, OwnMesh, list[str]]:
    """Vertices (n, 3) without any key, identity and expression offsets, their sliders, and what was
    left out.
    """
    mesh, prefix = item.data, item.facestage_face.identity_prefix.lower()
    offsets: dict[bool, list[np.ndarray]] = {True: [], False: []}
    own = OwnMesh({}, {})
    none = np.zeros((0, len(mesh.vertices), 3), np.float32)
    if mesh.shape_keys is None or len(mesh.shape_keys.key_blocks) < 2:
        return (
            _points(mesh.vertices),
            none,
            none,
            own,
            [f"'{item.name}' has no shape keys: no expression is fitted"],
        )
    if not mesh.shape_keys.use_relative:
        raise InputError(
            f"The shape keys of '{item.name}' are absolute; turn on Relative in Object Data > "
            "Shape Keys."
        )
    driven = _driven(mesh.shape_keys)
    reference = mesh.shape_keys.reference_key
    base = _points(reference.data)
    size = max(float(np.ptp(base, axis=0).max()), 1e-12)
    left_out: dict[str, list[str]] = {}
    for key in mesh.shape_keys.key_blocks:
        if key == reference or key.name == SHAPE_KEY:
            continue
        offset = _points(key.data) - _points(key.relative_key.data)
        if key.vertex_group:
            offset *= _group_weights(item, key.vertex_group)[:, None]
        why = "driven" if key.name in driven else "muted" if key.mute else ""
        if not why and np.abs(offset).max() < 1e-7 * size:
            why = "without effect"
        if why:
            left_out.setdefault(why, []).append(key.name)
            continue
        low, high = float(key.slider_min), float(key.slider_max)
        if prefix and key.name.lower().startswith(prefix):
            factor = max(abs(low), abs(high)) / IDENTITY_SPREAD
            own.identity[key.name] = (key.name, factor)
            offsets[True].append(factor * offset)
            continue
        for name, factor in ((key.name, high), (f"{key.name} (negative)", low)):
            if factor > 0 or (factor < 0 and name != key.name):
                own.expression[name] = (key.name, factor)
                offsets[False].append(factor * offset)
    notes = [f"{len(names)} {why} shape keys are left out" for why, names in left_out.items()]
    identity, expression = (
        np.stack(offsets[kind]).astype(np.float32) if offsets[kind] else none
        for kind in (True, False)
    )
    return base, identity, expression, own, notes


def model_frame(rig: RigFile, model: FaceModel) -> np.ndarray:
    """(4, 4) from the mesh's own coordinates to the model frame, from the same vertices in both."""
    if len(model.vertices) != len(rig.vertices):
        raise InputError(
            f"The backend's model has {len(model.vertices)} vertices, the mesh "
            f"{len(rig.vertices)}; press Use My Mesh "
            "again."
        )
    middle = rig.vertices.mean(axis=0)
    size = max(float(np.ptp(rig.vertices)), 1e-12)
    columns = np.concatenate(
        [(rig.vertices - middle) / size, np.ones((len(rig.vertices), 1))], axis=1
    )
    solution = np.linalg.lstsq(columns, model.vertices.astype(np.float64), rcond=None)[0]
    matrix = np.eye(4)
    matrix[:3, :3] = solution[:3].T / size
    matrix[:3, 3] = solution[3] - matrix[:3, :3] @ middle
    return matrix


def read_own_weights(
    rig: bpy.types.Object, own: OwnMesh
) -> tuple[dict[str, float], dict[str, float]]:
    """Identity and expression weights by the model's names, as the sliders show them."""
    keys = _key_blocks(rig)
    values = {name: key.value for name, key in keys.items()}

    def weights(shapes: dict[str, tuple[str, float]], low: float) -> dict[str, float]:
        return {
            name: max(low, float(values[key]) / factor) if key in values else 0.0
            for name, (key, factor) in shapes.items()
        }

    shown = float(values.get(SHAPE_KEY, 0.0))
    borrowed = {name: value * shown for name, value in own.borrowed.items()}
    return weights(own.identity, -np.inf) | borrowed, weights(own.expression, 0.0)


def own_slider_values(
    rig: bpy.types.Object, own: OwnMesh, identity: dict[str, float], expression: dict[str, float]
) -> dict[str, float]:
    """Values of the user's sliders for the given weights; identity modes that are not theirs:
    :func:`write_shape`.

    Raises InputError for a slider that is gone.
    """
    keys = _key_blocks(rig)
    values: dict[str, float] = {}
    for shapes, weights in ((own.identity, identity), (own.expression, expression)):
        for name, weight in weights.items():
            if name in own.borrowed or (shapes is own.identity and not own.identity):
                continue
            if name not in shapes or shapes[name][0] not in keys:
                raise InputError(
                    f"The mesh '{rig.name}' has no shape key "
                    f"'{shapes.get(name, (name, 0))[0]}' any more; press Use My "
                    "Mesh again."
                )
            key, factor = shapes[name]
            values[key] = values.get(key, 0.0) + factor * float(weight)
    return values


def write_shape(
    rig: bpy.types.Object, own: OwnMesh, weights: dict[str, float], offsets: np.ndarray
) -> None:
    """Put the part of the fitted shape that no slider of the mesh makes into one shape key of its
    own.

    weights: the default model's identity modes; offsets (n, 3) in the mesh's own coordinates.
    """
    key = _key_blocks(rig).get(SHAPE_KEY) or _new_key(rig, SHAPE_KEY)
    reference = rig.data.shape_keys.reference_key
    key.relative_key, key.mute, key.vertex_group = reference, False, ""
    key.slider_min, key.slider_max = 0.0, 1.0
    key.data.foreach_set("co", (_points(reference.data) + offsets).astype(np.float32).ravel())
    key.value = 1.0
    own.borrowed = dict(weights)
    own.store(rig)
    rig.data.update()


def read_marks(item: bpy.types.Object) -> dict[str, np.ndarray]:
    """Marked landmarks: name in MARKS -> vertex indices.

    They are vertex groups, so that they survive editing.
    """
    group_name = {
        group.index: group.name[len(MARK_GROUP) :]
        for group in item.vertex_groups
        if group.name.startswith(MARK_GROUP)
    }
    found: dict[str, list[int]] = {}
    if group_name:
        for vertex in item.data.vertices:
            for member in vertex.groups:
                if member.group in group_name and member.weight > 0:
                    found.setdefault(group_name[member.group], []).append(vertex.index)
    return {name: np.array(indices, np.int32) for name, indices in found.items() if name in MARKS}


def mark(item: bpy.types.Object, name: str) -> int:
    """Make the selected vertices a landmark's place; returns how many.

    Raises InputError when none is selected.
    """
    chosen = [vertex.index for vertex in item.data.vertices if vertex.select]
    if not chosen:
        raise InputError(
            f"No vertex of '{item.name}' is selected; select the vertex of the landmark in "
            "Edit Mode."
        )
    clear_mark(item, name)
    item.vertex_groups.new(name=MARK_GROUP + name).add(chosen, 1.0, "REPLACE")
    return len(chosen)


def clear_mark(item: bpy.types.Object, name: str) -> None:
    """Forget a landmark's place."""
    group = item.vertex_groups.get(MARK_GROUP + name)
    if group is not None:
        item.vertex_groups.remove(group)


def guessed_part(name: str) -> int:
    """The part of the face that a material's name speaks of, or UNKNOWN_PART."""
    for part, words in _PART_WORDS:
        if re.search(words, name, re.IGNORECASE):
            return part
    return UNKNOWN_PART


def _driven(keys: bpy.types.Key) -> set[str]:
    """Names of shape keys whose value an expression or a bone sets: a fit cannot move them."""
    if keys.animation_data is None:
        return set()
    paths = [driver.data_path for driver in keys.animation_data.drivers]
    return {
        key.name
        for key in keys.key_blocks
        if any(path == key.path_from_id("value") for path in paths)
    }


def _group_weights(item: bpy.types.Object, name: str) -> np.ndarray:
    weights = np.zeros(len(item.data.vertices))
    group = item.vertex_groups.get(name)
    if group is not None:
        for vertex in item.data.vertices:
            weights[vertex.index] = next(
                (m.weight for m in vertex.groups if m.group == group.index), 0.0
            )
    return weights


def _quads_and_triangles(mesh: bpy.types.Mesh) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices and corners (p, 4) int32 of quads and triangles, and the face (p,) each comes from;
    n-gons are split.
    """
    start, total = np.empty((2, len(mesh.polygons)), np.int32)
    mesh.polygons.foreach_get("loop_start", start)
    mesh.polygons.foreach_get("loop_total", total)
    vertex = np.empty(len(mesh.loops), np.int32)
    mesh.loops.foreach_get("vertex_index", vertex)
    small = np.flatnonzero(total <= 4)
    corners = start[small, None] + np.arange(4, dtype=np.int32)
    corners[total[small] == 3, 3] = -1
    source = small
    if len(small) < len(total):
        mesh.calc_loop_triangles()
        loops = np.empty(3 * len(mesh.loop_triangles), np.int32)
        owner = np.empty(len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("loops", loops)
        mesh.loop_triangles.foreach_get("polygon_index", owner)
        large = total[owner] > 4
        split = np.full((int(large.sum()), 4), -1, np.int32)
        split[:, :3] = loops.reshape(-1, 3)[large]
        corners, source = np.concatenate([corners, split]), np.concatenate([small, owner[large]])
    polygons = np.where(corners >= 0, vertex[np.maximum(corners, 0)], -1).astype(np.int32)
    return polygons, corners, source


def slot_parts(item: bpy.types.Object) -> list[int]:
    """The part of the face in each material slot: as the user marked the material, else by its
    name.
    """
    parts = []
    for slot in item.material_slots:
        material = slot.material
        marked = material.facestage_part if material is not None else "AUTO"
        if marked != "AUTO":
            parts.append(PARTS.index(marked.lower()))
        else:
            parts.append(guessed_part(material.name) if material is not None else UNKNOWN_PART)
    return parts


def _parts(item: bpy.types.Object) -> np.ndarray:
    """(faces,) uint8 part of each face by its material."""
    index = np.empty(len(item.data.polygons), np.int32)
    item.data.polygons.foreach_get("material_index", index)
    table = np.array(slot_parts(item) or [UNKNOWN_PART], np.uint8)
    return table[np.minimum(index, len(table) - 1)]


def _key_blocks(rig: bpy.types.Object) -> bpy.types.bpy_prop_collection:
    keys = rig.data.shape_keys
    return keys.key_blocks if keys is not None else {}


def _new_key(rig: bpy.types.Object, name: str) -> bpy.types.ShapeKey:
    if rig.data.shape_keys is None:
        rig.shape_key_add(name="Basis", from_mix=False)
    return rig.shape_key_add(name=name, from_mix=False)


def _points(data: bpy.types.bpy_prop_collection) -> np.ndarray:
    """(n, 3) float64 coordinates of vertices or of a shape key's points."""
    flat = np.empty(3 * len(data), np.float32)
    data.foreach_get("co", flat)
    return flat.reshape(-1, 3).astype(np.float64)
