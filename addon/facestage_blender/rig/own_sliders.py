"""The shape keys of a user's mesh: read as a face's shapes, moved, and one for the fitted shape."""

from __future__ import annotations

import bpy
import numpy as np

from facestage.contract.errors import InputError

from . import relief_key
from .own_record import OwnMesh
from .sliders import is_bound

SHAPE_KEY = "Facestage Shape"

IDENTITY_SPREAD = 2.0  # standard deviations from rest to the end of an identity slider


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
        if key == reference or key.name in (SHAPE_KEY, relief_key.NAME):
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
                    f"The mesh '{rig.name}' has no shape key '{shapes.get(name, (name, 0))[0]}' "
                    "any more; press Use My Mesh again."
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


def _driven(keys: bpy.types.Key) -> set[str]:
    """Names of shape keys whose value an expression or a bone sets: a fit cannot move them. Those
    that a control rig's handles add to have a slider beside it.
    """
    if keys.animation_data is None:
        return set()
    paths = [driver.data_path for driver in keys.animation_data.drivers]
    return {
        key.name
        for key in keys.key_blocks
        if not is_bound(key) and any(path == key.path_from_id("value") for path in paths)
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
