"""Where the edges of cast shadows cross scan lines on the lights, found by shadow rays and bisection."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from facestage.contract.light_stage import LightStage
from facestage.render.brdf import specular_lobe, view_cosine
from facestage.render.tracer import LIGHT_SALT, SHADOW_OFFSET, RayTracer, hash_to_unit

# Shadow rays along a scan line: three cells find each edge on their own unless two lie in a third of the light.
LINE_POINTS = 4
# The occluder's edge is then known to a few micrometres for a light of 0.2 m and a nose of 3 cm.
BISECTIONS = 12
# Keeps the scan lines' random numbers apart from those of the light samples.
LINE_SALT = 0x5BD1E995


@dataclass(frozen=True)
class Crossings:
    """M places on the lights between which and a lit point lies the edge of a shadow.

    Seen from its point, the light is visible on one side of ``target`` and blocked on the other, along the
    light's ``axis`` (0: axis_x, 1: axis_y). ``triangle`` is what the last blocked ray hits first. ``diffuse`` and ``specular`` are the irradiance (n.l) and (n.l) D V F of unit
    radiance that one metre of the scan line adds, averaged over the lines.
    """

    point: np.ndarray  # (M,) int32
    light: np.ndarray  # (M,) int32
    axis: np.ndarray  # (M,) 0 or 1
    visible_before: np.ndarray  # (M,) bool: visible below the crossing, blocked above
    target: np.ndarray  # (M, 3) m, on the light
    triangle: np.ndarray  # (M,) int32
    diffuse: np.ndarray  # (M,)
    specular: np.ndarray  # (M,)


def shadow_crossings(
    tracer: RayTracer,
    points: np.ndarray,
    normals: np.ndarray,
    facing: np.ndarray,
    views: np.ndarray,
    stage: LightStage,
    roughness: float,
    pairs: tuple[np.ndarray, np.ndarray],
    keys: np.ndarray,
    lines: int,
    seed: int,
) -> Crossings:
    """Crossings of shadow edges with ``lines`` scan lines along each side of a light, for ``pairs`` (point, light).

    The other arguments are those of :meth:`RayTracer.light_terms`. The lines of a pair are spread evenly over
    the square, shifted by a number that depends on ``seed``, the point's key and the light alone.
    """
    point_of, light_of = (np.ascontiguousarray(index, np.uint32) for index in pairs)
    if not len(point_of):
        return _none()
    rows = _Rows(points, normals, facing, views, stage, keys, dr.opaque(mi.UInt32, 2 * seed))
    # One lane per pair, axis and line.
    count = len(point_of) * 2 * lines
    lane = dr.arange(mi.UInt32, count)
    pair = lane // dr.opaque(mi.UInt32, 2 * lines)
    within = lane - pair * dr.opaque(mi.UInt32, 2 * lines)
    number = within // 2
    square = rows.at(
        dr.gather(mi.UInt32, mi.UInt32(point_of), pair), dr.gather(mi.UInt32, mi.UInt32(light_of), pair),
        within - 2 * number,
    )  # fmt: skip
    across = (mi.Float(number) + square.shift) / dr.opaque(mi.Float, float(lines))
    blocked = mi.UInt32(0)
    for k in range(LINE_POINTS):
        blocked |= dr.select(_blocked(tracer, square, mi.Float(k / (LINE_POINTS - 1)), across), mi.UInt32(1 << k), 0)
    dr.eval(blocked, across)
    bits, across_all = np.array(blocked), np.array(across)
    change = (bits ^ (bits >> 1)) & ((1 << (LINE_POINTS - 1)) - 1)
    changed = np.flatnonzero(change)
    if not len(changed):
        return _none()
    which, cell = np.nonzero((change[changed, None] >> np.arange(LINE_POINTS - 1)) & 1)
    lanes = changed[which]
    return _refine(
        tracer, rows, point_of[lanes // (2 * lines)], light_of[lanes // (2 * lines)], lanes % 2, across_all[lanes],
        cell, ((bits[lanes] >> cell) & 1) == 0, lines, roughness,
    )  # fmt: skip


@dataclass(frozen=True)
class _Square:
    """Lanes that look at a light's square along one of its axes."""

    x: Any
    n: Any
    v: Any
    origin: Any
    centre: Any
    emit: Any
    along: Any  # the scan line's axis, as long as the side
    cross: Any
    side: Any
    shift: Any


class _Rows:
    """The arrays that lanes gather from."""

    def __init__(
        self, points: np.ndarray, normals: np.ndarray, facing: np.ndarray, views: np.ndarray, stage: LightStage,
        keys: np.ndarray, seed: mi.UInt32,
    ) -> None:  # fmt: skip
        self._vectors = [_flat(array) for array in (points, normals, facing, views)]
        self._light = [
            _flat(array)
            for array in (
                stage.position, stage.direction, stage.axis_x * stage.side[:, None], stage.axis_y * stage.side[:, None]
            )
        ]  # fmt: skip
        self._side = _flat(stage.side)
        self._keys = mi.UInt32(np.ascontiguousarray(keys, np.uint32))
        self._seed = seed

    def at(self, point: Any, light: Any, axis: Any) -> _Square:
        x, n, facing, v = (dr.gather(mi.Vector3f, array, point) for array in self._vectors)
        centre, emit, axis_x, axis_y = (dr.gather(mi.Vector3f, array, light) for array in self._light)
        key = dr.gather(mi.UInt32, self._keys, point)
        salt = light * mi.UInt32(LIGHT_SALT) + self._seed + axis + mi.UInt32(LINE_SALT)
        first = axis == 0
        return _Square(
            x, n, v, x + SHADOW_OFFSET * facing, centre, emit, dr.select(first, axis_x, axis_y),
            dr.select(first, axis_y, axis_x), dr.gather(mi.Float, self._side, light), hash_to_unit(key, salt),
        )  # fmt: skip


def _target(square: _Square, along: Any, across: Any) -> Any:
    return square.centre + square.along * (along - 0.5) + square.cross * (across - 0.5)


def _shadow_ray(square: _Square, along: Any, across: Any) -> Any:
    span = _target(square, along, across) - square.origin
    distance = dr.norm(span)
    return mi.Ray3f(square.origin, span / distance, distance * (1 - 1e-4), 0, [])


def _blocked(tracer: RayTracer, square: _Square, along: Any, across: Any) -> Any:
    return tracer.scene.ray_test(_shadow_ray(square, along, across))


def _refine(
    tracer: RayTracer, rows: _Rows, point: np.ndarray, light: np.ndarray, axis: np.ndarray, across: np.ndarray,
    cell: np.ndarray, visible_before: np.ndarray, lines: int, roughness: float,
) -> Crossings:  # fmt: skip
    """Bisect between the ends of each cell and look at what blocks there."""
    square = rows.at(mi.UInt32(point), mi.UInt32(light), mi.UInt32(axis.astype(np.uint32)))
    fixed = mi.Float(across.astype(np.float32))
    ends = [(cell + end).astype(np.float32) / (LINE_POINTS - 1) for end in (0, 1)]
    visible = mi.Float(np.where(visible_before, ends[0], ends[1]))
    hidden = mi.Float(np.where(visible_before, ends[1], ends[0]))
    visible, hidden = _bisect(tracer, square, fixed, visible, hidden)
    hit = tracer.scene.ray_intersect_preliminary(_shadow_ray(square, hidden, fixed))
    target = _target(square, 0.5 * (visible + hidden), fixed)
    diffuse, specular = _irradiance(square, target, mi.Float(square.side / lines), dr.opaque(mi.Float, roughness))
    index = dr.select(hit.is_valid(), mi.Int32(hit.prim_index), -1)
    dr.eval(index, target, diffuse, specular)
    # A light point below the horizon adds nothing.
    keep = (np.array(index) >= 0) & (np.array(diffuse) > 0)
    return Crossings(
        point.astype(np.int32)[keep], light.astype(np.int32)[keep], axis[keep], visible_before[keep],
        np.stack([np.array(target.x), np.array(target.y), np.array(target.z)], axis=1)[keep], np.array(index)[keep],
        np.array(diffuse)[keep], np.array(specular)[keep],
    )  # fmt: skip


def _bisect(tracer: RayTracer, square: _Square, across: Any, visible: Any, hidden: Any) -> tuple[Any, Any]:
    for _ in range(BISECTIONS):
        middle = 0.5 * (visible + hidden)
        blocked = _blocked(tracer, square, middle, across)
        visible, hidden = dr.select(blocked, visible, middle), dr.select(blocked, middle, hidden)
        # One small kernel, used again in every round.
        dr.eval(visible, hidden)
    return visible, hidden


def _irradiance(square: _Square, target: Any, width: Any, roughness: Any) -> tuple[Any, Any]:
    """Of a strip of the light at ``target``, ``width`` m wide, per metre of its length."""
    offset = target - square.x
    inverse = dr.rsqrt(dr.squared_norm(offset))
    light = offset * inverse
    nl = dr.dot(square.n, light)
    cosine = -dr.dot(square.emit, light)
    weight = dr.select((nl > 0) & (cosine > 0), width * cosine * dr.square(inverse), 0)
    half = dr.normalize(light + square.v)
    nh, vh = dr.maximum(dr.dot(square.n, half), 0), dr.clip(dr.dot(square.v, half), 0, 1)
    lobe = specular_lobe(
        dr.maximum(nl, 0), view_cosine(square.n, square.v), dr.squared_norm(dr.cross(square.n, half)), nh, vh, roughness
    )
    return weight * nl, dr.select(weight > 0, weight * lobe.value, 0)


def _flat(array: np.ndarray) -> mi.Float:
    return mi.Float(np.ascontiguousarray(array, np.float32).ravel())


def _none() -> Crossings:
    index, number, triple = np.zeros(0, np.int32), np.zeros(0, np.float32), np.zeros((0, 3), np.float32)
    return Crossings(index, index, index, np.zeros(0, bool), triple, index, number, number)
