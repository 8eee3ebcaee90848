"""A rig as the solver sees it: chosen points of its surface, and how its sliders move them."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np

from ..rig import relief_key
from ..rig.face_rig import IDENTITY, SLIDER_RANGE
from ..rig.own_record import OwnMesh
from ..rig.sliders import is_bound, value_path
from .solver import Shapes

# Standard deviations as in the backend: of an identity mode 1, of an expression from 0 to 1 this.
EXPRESSION_SIGMA = 0.35


@dataclass(frozen=True)
class Slider:
    """A shape key that a face may move."""

    name: str
    spread: float
    low: float
    high: float


def sliders_of(rig: bpy.types.Object) -> list[Slider]:
    """The sliders that the solver may move: identity and expressions, neither muted nor driven,
    nor of a part of the mesh alone.
    """
    keys = rig.data.shape_keys
    if keys is None:
        return []
    animation = keys.animation_data
    driven = {each.data_path for each in animation.drivers} if animation is not None else set()
    # What a control rig's handles add to has a slider beside it.
    driven -= {value_path(key) for key in keys.key_blocks if is_bound(key)}
    own = OwnMesh.of(rig)
    found = _own_sliders(own) if own is not None else _model_sliders(list(keys.key_blocks)[1:])
    return [
        each
        for each in found
        if each.name in keys.key_blocks
        and not keys.key_blocks[each.name].mute
        and not keys.key_blocks[each.name].vertex_group
        and value_path(keys.key_blocks[each.name]) not in driven
    ]


def _model_sliders(keys: list[bpy.types.ShapeKey]) -> list[Slider]:
    found = []
    for key in keys:
        if key.name == relief_key.NAME:
            continue
        box = not key.name.startswith(IDENTITY) and key.slider_min >= 0
        found.append(
            Slider(key.name, EXPRESSION_SIGMA, 0.0, 1.0)
            if box
            else Slider(key.name, 1.0, -SLIDER_RANGE, SLIDER_RANGE)
        )
    return found


def _own_sliders(own: OwnMesh) -> list[Slider]:
    found = {
        name: Slider(name, abs(factor), -SLIDER_RANGE * abs(factor), SLIDER_RANGE * abs(factor))
        for name, factor in own.identity.values()
    }
    for name, factor in own.expression.values():
        other = found.get(name)
        low, high = min(factor, 0.0), max(factor, 0.0)
        if other is not None:  # a slider to both sides is two expressions
            low, high = min(low, other.low), max(high, other.high)
        found[name] = Slider(name, EXPRESSION_SIGMA * max(-low, high), low, high)
    return list(found.values())


def read_values(rig: bpy.types.Object, sliders: list[Slider]) -> np.ndarray:
    """(k,) what the face shows of the sliders, handles and all."""
    keys = rig.data.shape_keys
    return np.array([keys.key_blocks[each.name].value for each in sliders], np.float64)


def read_handles(rig: bpy.types.Object, sliders: list[Slider]) -> np.ndarray:
    """(k,) what a control rig's handles add to the sliders; 0 without one."""
    keys = [rig.data.shape_keys.key_blocks[each.name] for each in sliders]
    return np.array(
        [key.value - key.id_data[key.name] if is_bound(key) else 0.0 for key in keys], np.float64
    )


def read_shapes(
    rig: bpy.types.Object, sliders: list[Slider], corners: np.ndarray, weights: np.ndarray
) -> Shapes:
    """Of the surface's points with these ``corners`` (m, 3) and barycentric ``weights`` (m, 3), in
    the mesh's own coordinates. What no slider here moves stays as it is now.
    """
    keys, count = rig.data.shape_keys, len(rig.data.vertices)
    modes = np.zeros((len(sliders), len(corners), 3))
    place = {each.name: index for index, each in enumerate(sliders)}
    if keys is None:
        return _shapes(_at(_points(rig.data.vertices, count), corners, weights), modes, sliders)
    rest = _at(_points(keys.reference_key, count), corners, weights)
    for key in keys.key_blocks:
        held = 0.0 if key.mute or key == keys.reference_key else key.value
        if key.name not in place and held == 0.0:
            continue
        offset = _at(_points(key, count), corners, weights) - _at(
            _points(key.relative_key, count), corners, weights
        )
        if key.name in place:
            modes[place[key.name]] = offset
        else:
            rest = rest + held * offset
    return _shapes(rest, modes, sliders)


def current_vertices(rig: bpy.types.Object) -> np.ndarray:
    """(n, 3) the mesh under its sliders, in its own coordinates."""
    keys, count = rig.data.shape_keys, len(rig.data.vertices)
    if keys is None:
        return _points(rig.data.vertices, count).astype(np.float64)
    result = _points(keys.reference_key, count).astype(np.float64)
    for key in keys.key_blocks:
        if key.value and not key.mute and key != keys.reference_key:
            result += key.value * (_points(key, count) - _points(key.relative_key, count))
    return result


def _shapes(rest: np.ndarray, modes: np.ndarray, sliders: list[Slider]) -> Shapes:
    spread, low, high = (
        np.array([getattr(each, name) for each in sliders], np.float64)
        for name in ("spread", "low", "high")
    )
    return Shapes(rest, np.ascontiguousarray(np.moveaxis(modes, 0, 2)), spread, low, high)


def _points(owner: object, count: int) -> np.ndarray:
    """(n, 3) float32 of vertices or of a shape key."""
    result = np.empty(3 * count, np.float32)
    if isinstance(owner, bpy.types.ShapeKey):
        # Blender 4.1 and later have the same as plain points, a hundred times faster.
        owner = getattr(owner, "points", owner.data)
    owner.foreach_get("co", result)  # type: ignore[attr-defined]
    return result.reshape(-1, 3)


def _at(points: np.ndarray, corners: np.ndarray, weights: np.ndarray) -> np.ndarray:
    return np.asarray(np.einsum("mi,mix->mx", weights, points[corners].astype(np.float64)))
