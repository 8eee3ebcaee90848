"""Where the edges of cast shadows cross scan lines on the lights, found by shadow rays and
bisection.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from facestage.render.brdf import HalfVector, lobe_about, view_cosine
from facestage.render.light_kernel import LIGHT_SALT, floats, hash_to_unit, shadow_ray
from facestage.render.light_terms import LitPoints
from facestage.render.tracer import SHADOW_OFFSET, RayTracer

# Shadow rays along a scan line: three cells find each edge on their own unless two lie in a third
# of the light.
LINE_POINTS = 4
# The occluder's edge is then known to a few micrometres for a light of 0.2 m and a nose of 3 cm.
BISECTIONS = 12
# Keeps the scan lines' random numbers apart from those of the light samples.
LINE_SALT = 0x5BD1E995


@dataclass(frozen=True)
class Cells:
    """M stretches of scan lines on the lights, one end visible from a point and the other hidden.

    A line runs along the light's ``axis`` (0: axis_x, 1: axis_y) at ``across`` on the other, both
    from 0 to 1.
    """

    point: np.ndarray  # (M,) int
    light: np.ndarray  # (M,) int
    axis: np.ndarray  # (M,) 0 or 1
    across: np.ndarray  # (M,) 0..1
    visible: np.ndarray  # (M,) 0..1 along the axis, the end that is visible
    hidden: np.ndarray  # (M,) 0..1 along the axis, the end that is not
    lines: int  # scan lines along each axis of each light


@dataclass(frozen=True)
class Crossings:
    """Where in its cell the edge of a shadow lies, and what hides the light there.

    ``triangle`` is what the last blocked ray hits first. ``diffuse`` and ``specular`` are the
    irradiance (n.l) and (n.l) D V F at unit radiance that one metre of the scan line adds, averaged
    over the lines; 0 where there is no edge to be found.
    """

    target: np.ndarray  # (M, 3) m, on the light
    triangle: np.ndarray  # (M,) int
    diffuse: np.ndarray  # (M,)
    specular: np.ndarray  # (M,)


def shadow_cells(
    tracer: RayTracer, lit: LitPoints, pairs: tuple[np.ndarray, np.ndarray], lines: int, seed: int
) -> Cells:
    """Cells of ``lines`` scan lines along each side of the light, for ``pairs`` (K,) of point and
    (K,) of light.

    The lines of a pair are spread evenly over the square, shifted by a number that depends on
    ``seed``, the point's key and the light alone. Sorted by pair.
    """
    point_of, light_of = (np.ascontiguousarray(index, np.uint32) for index in pairs)
    if not len(point_of):
        return _no_cells(lines)
    # One lane per pair, axis and line.
    per_pair = dr.opaque(mi.UInt32, 2 * lines)
    lane = dr.arange(mi.UInt32, len(point_of) * 2 * lines)
    pair = lane // per_pair
    within = lane - pair * per_pair
    number = within // 2
    axis = within - 2 * number
    point = dr.gather(mi.UInt32, mi.UInt32(point_of), pair)
    light = dr.gather(mi.UInt32, mi.UInt32(light_of), pair)
    # The factor keeps the lights' numbers apart.
    number_of = dr.gather(mi.UInt32, mi.UInt32(np.ascontiguousarray(lit.numbers, np.uint32)), light)
    salt = (
        number_of * mi.UInt32(LIGHT_SALT)
        + dr.opaque(mi.UInt32, 2 * seed)
        + axis
        + mi.UInt32(LINE_SALT)
    )
    shift = hash_to_unit(
        dr.gather(mi.UInt32, mi.UInt32(np.ascontiguousarray(lit.keys, np.uint32)), point), salt
    )
    across = (mi.Float(number) + shift) / dr.opaque(mi.Float, float(lines))
    square = _Square(lit, point, light, axis)
    blocked = mi.UInt32(0)
    for k in range(LINE_POINTS):
        along = mi.Float(k / (LINE_POINTS - 1))
        blocked |= dr.select(
            tracer.scene.ray_test(square.shadow_ray(along, across)), mi.UInt32(1 << k), 0
        )
    dr.eval(blocked, across)
    bits = np.array(blocked)
    change = (bits ^ (bits >> 1)) & ((1 << (LINE_POINTS - 1)) - 1)
    lanes = np.flatnonzero(change)
    which, cell = np.nonzero((change[lanes, None] >> np.arange(LINE_POINTS - 1)) & 1)
    lanes = lanes[which]
    hidden_first = (bits[lanes] >> cell) & 1
    index = lanes // (2 * lines)
    return Cells(
        point_of[index].astype(np.int64),
        light_of[index].astype(np.int64),
        lanes % 2,
        np.array(across)[lanes],
        (cell + hidden_first) / (LINE_POINTS - 1),
        (cell + 1 - hidden_first) / (LINE_POINTS - 1),
        lines,
    )


def shadow_crossings(tracer: RayTracer, lit: LitPoints, cells: Cells) -> Crossings:
    """Bisect the cells and look at what blocks the light there."""
    if not len(cells.point):
        number = np.zeros(0)
        return Crossings(np.zeros((0, 3)), np.zeros(0, np.int64), number, number)
    point, light, axis = (
        mi.UInt32(index.astype(np.uint32)) for index in (cells.point, cells.light, cells.axis)
    )
    square = _Square(lit, point, light, axis)
    across, visible, hidden = (
        mi.Float(place.astype(np.float32)) for place in (cells.across, cells.visible, cells.hidden)
    )
    for _ in range(BISECTIONS):
        middle = 0.5 * (visible + hidden)
        blocked = tracer.scene.ray_test(square.shadow_ray(middle, across))
        visible, hidden = dr.select(blocked, visible, middle), dr.select(blocked, middle, hidden)
        # One small kernel, used again in every round.
        dr.eval(visible, hidden)
    hit = tracer.scene.ray_intersect_preliminary(square.shadow_ray(hidden, across))
    target = square.target(0.5 * (visible + hidden), across)
    diffuse, specular = _irradiance(square, target, dr.opaque(mi.Float, lit.roughness))
    found = hit.is_valid()
    triangle = dr.select(found, mi.Int32(hit.prim_index), 0)
    width = dr.select(found, square.side / cells.lines, 0)
    diffuse, specular = diffuse * width, specular * width
    dr.eval(triangle, target, diffuse, specular)
    return Crossings(
        np.stack([np.array(target.x), np.array(target.y), np.array(target.z)], axis=1).astype(
            float
        ),
        np.array(triangle),
        np.array(diffuse),
        np.array(specular),
    )


class _Square:
    """Lanes that look at a light's square along one of its axes."""

    def __init__(self, lit: LitPoints, point: Any, light: Any, axis: Any) -> None:
        def gather(array: np.ndarray, index: Any) -> Any:
            return dr.gather(mi.Vector3f, floats(array), index)

        stage = lit.stage
        self.x, self.n, self.v = (
            gather(array, point) for array in (lit.points, lit.normals, lit.views)
        )
        self.origin = self.x + SHADOW_OFFSET * gather(lit.facing, point)
        self.centre, self.emit = gather(stage.position, light), gather(stage.direction, light)
        axis_x = gather(stage.axis_x * stage.side[:, None], light)
        axis_y = gather(stage.axis_y * stage.side[:, None], light)
        first = axis == 0
        self.along, self.across = dr.select(first, axis_x, axis_y), dr.select(first, axis_y, axis_x)
        self.side = dr.gather(mi.Float, floats(stage.side), light)

    def target(self, along: Any, across: Any) -> Any:
        return self.centre + self.along * (along - 0.5) + self.across * (across - 0.5)

    def shadow_ray(self, along: Any, across: Any) -> Any:
        return shadow_ray(self.origin, self.target(along, across))


def _irradiance(square: _Square, target: Any, roughness: Any) -> tuple[Any, Any]:
    """(n.l) and (n.l) D V F of unit radiance from a square metre of the light at ``target``; 0
    below the horizon.
    """
    offset = target - square.x
    inverse = dr.rsqrt(dr.squared_norm(offset))
    light = offset * inverse
    nl = dr.dot(square.n, light)
    cosine = -dr.dot(square.emit, light)
    weight = dr.select((nl > 0) & (cosine > 0), cosine * dr.square(inverse), 0)
    half, nv = HalfVector.between(light, square.v), view_cosine(square.n, square.v)
    lobe = lobe_about(half, square.n, square.v, nl, nv, roughness)
    return weight * nl, dr.select(weight > 0, weight * lobe.value, 0)


def _no_cells(lines: int) -> Cells:
    index, number = np.zeros(0, np.int64), np.zeros(0)
    return Cells(index, index, index, number, number, number, lines)
