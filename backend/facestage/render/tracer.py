"""Primary visibility and light-by-light direct illumination with self-shadows, by ray tracing."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from facestage.contract.light_stage import LightStage
from facestage.render.brdf import specular_lobe, view_cosine

# Shadow rays start this far off the surface (metres): facets of a smooth-shaded mesh must not shadow
# themselves, and nothing on a face that casts a shadow is thinner.
SHADOW_OFFSET = 2e-4
LIGHT_SALT = 0x9E3779B1


@dataclass(frozen=True)
class Hits:
    """What each of P rays hits first: triangle index (-1: nothing) and barycentric weights."""

    triangle: np.ndarray  # (P,) int32
    barycentric: np.ndarray  # (P, 3) float32


def _not_asked() -> np.ndarray:
    return np.zeros(0, np.float32)


@dataclass(frozen=True)
class LightTerms:
    """Irradiance of P points from N lights at unit radiance; self-shadows included.

    ``diffuse`` is the integral of (n.l) over the visible solid angle, ``specular`` that of
    (n.l) D V F. Derivatives keep the visibility fixed; ``*_by_depth`` moves the point along its
    view ray (away from the camera, per metre); they are empty unless asked for.
    """

    diffuse: np.ndarray  # (P, N)
    specular: np.ndarray  # (P, N)
    diffuse_by_normal: np.ndarray = field(default_factory=_not_asked)  # (P, N, 3)
    specular_by_normal: np.ndarray = field(default_factory=_not_asked)  # (P, N, 3)
    diffuse_by_depth: np.ndarray = field(default_factory=_not_asked)  # (P, N)
    specular_by_depth: np.ndarray = field(default_factory=_not_asked)  # (P, N)
    specular_by_roughness: np.ndarray = field(default_factory=_not_asked)  # (P, N)


class RayTracer:
    """A triangle mesh that rays can hit. The frame is the caller's; keep its origin near the face."""

    def __init__(self, triangles: np.ndarray, vertex_count: int) -> None:
        """``triangles`` (t, 3) int; positions come with :meth:`update`."""
        self._mesh = mi.Mesh("face", vertex_count=vertex_count, face_count=len(triangles))
        self._parameters = mi.traverse(self._mesh)
        self._parameters["faces"] = mi.UInt32(np.ascontiguousarray(triangles, np.uint32).ravel())
        # Degenerate starting positions would break the acceleration structure: spread them a little.
        start = np.linspace(0.0, 1.0, vertex_count * 3, dtype=np.float32)
        self._parameters["vertex_positions"] = mi.Float(start)
        self._parameters.update()
        self.scene = mi.load_dict({"type": "scene", "face": self._mesh})
        self._scene_parameters = mi.traverse(self.scene)

    def update(self, vertices: np.ndarray) -> None:
        """Move the mesh to ``vertices`` (n, 3) metres."""
        self._scene_parameters["face.vertex_positions"] = mi.Float(np.ascontiguousarray(vertices, np.float32).ravel())
        self._scene_parameters.update()

    def first_hits(self, origin: np.ndarray, directions: np.ndarray) -> Hits:
        """First triangle along unit ``directions`` (P, 3) from ``origin`` (3,) or (P, 3)."""
        if len(directions) == 0:
            # A trace of no ray at all aborts the process inside Dr.Jit.
            return Hits(np.zeros(0, np.int32), np.zeros((0, 3), np.float32))
        ray = mi.Ray3f(mi.Point3f(_vector(np.broadcast_to(origin, directions.shape))), _vector(directions))
        hit = self.scene.ray_intersect_preliminary(ray)
        valid = hit.is_valid()
        u, v = dr.select(valid, hit.prim_uv.x, 0), dr.select(valid, hit.prim_uv.y, 0)
        index = dr.select(valid, mi.Int32(hit.prim_index), -1)
        dr.eval(index, u, v)
        u, v = np.asarray(u), np.asarray(v)
        return Hits(np.array(index), np.stack([1 - u - v, u, v], axis=1))

    def light_terms(
        self,
        points: np.ndarray,
        normals: np.ndarray,
        facing: np.ndarray,
        views: np.ndarray,
        stage: LightStage,
        roughness: float,
        samples: int,
        seed: int,
        derivatives: bool = False,
        specular: bool = True,
        shadows: bool = True,
        keys: np.ndarray | None = None,
        pairs: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> LightTerms:
        """Direct illumination of ``points`` (P, 3) by each light of ``stage`` (same frame, unit radiance).

        ``normals`` (P, 3) are the shading normals, ``facing`` (P, 3) the geometric ones on the viewer's
        side, ``views`` (P, 3) unit vectors towards the camera. ``samples`` per light, stratified by a
        rank-1 lattice with a shift per point and light that depends on ``seed`` and the point's key alone.
        ``keys`` (P,) int, by default 0, 1, 2, ...: give what names a point across calls, such as its pixel,
        so that it keeps its random numbers when other points come or go (common random numbers).
        ``pairs``: indices (K,) of points and (K,) of lights; only these are traced, and the terms are (K, 1).
        """
        count, lights = (len(points), len(stage)) if pairs is None else (len(pairs[0]), 1)
        if count == 0:
            return _empty(lights, derivatives)
        if pairs is None:
            lane = dr.arange(mi.UInt32, count * lights)
            lights_opaque = dr.opaque(mi.UInt32, lights)
            point_index = lane // lights_opaque
            light_index = lane - point_index * lights_opaque
        else:
            point_index, light_index = (mi.UInt32(np.ascontiguousarray(index, np.uint32)) for index in pairs)

        def gather(array: np.ndarray, index: mi.UInt32) -> mi.Vector3f:
            return dr.gather(mi.Vector3f, mi.Float(np.ascontiguousarray(array, np.float32).ravel()), index)

        x = gather(points, point_index)
        n = gather(normals, point_index)
        v = gather(views, point_index)
        origin = x + SHADOW_OFFSET * gather(facing, point_index)
        centre = gather(stage.position, light_index)
        emit = gather(stage.direction, light_index)
        axis_x = gather(stage.axis_x * stage.side[:, None], light_index)
        axis_y = gather(stage.axis_y * stage.side[:, None], light_index)
        area_each = dr.gather(mi.Float, mi.Float((stage.side**2 / samples).astype(np.float32)), light_index)
        names = np.arange(len(points)) if keys is None else keys
        key = dr.gather(mi.UInt32, mi.UInt32(np.ascontiguousarray(names, np.uint32)), point_index)
        # Opaque: another seed must not compile another kernel. The factor keeps the lights' numbers apart.
        salt = light_index * mi.UInt32(LIGHT_SALT) + dr.opaque(mi.UInt32, 2 * seed)
        shift_x, shift_y = hash_to_unit(key, salt + 1), hash_to_unit(key, salt + 2)
        rough = dr.opaque(mi.Float, float(roughness))
        nv = view_cosine(n, v)

        total = _accumulate(
            self.scene, dr.opaque(mi.UInt32, samples), x, n, v, nv, origin, centre, emit, axis_x, axis_y,
            area_each, shift_x, shift_y, rough, derivatives, specular, shadows,
        )  # fmt: skip
        dr.eval(*total)

        def scalar(value: mi.Float) -> np.ndarray:
            # A sum that was left out is a single zero.
            return np.broadcast_to(np.array(value), count * lights).reshape(count, lights)

        def vector(value: mi.Vector3f) -> np.ndarray:
            return np.stack([scalar(value.x), scalar(value.y), scalar(value.z)], axis=2)

        if not derivatives:
            return LightTerms(scalar(total[0]), scalar(total[1]))
        return LightTerms(
            scalar(total[0]), scalar(total[1]), vector(total[2]), vector(total[3]),
            scalar(total[4]), scalar(total[5]), scalar(total[6]),
        )  # fmt: skip


@dr.syntax
def _accumulate(
    scene: Any, samples: Any, x: Any, n: Any, v: Any, nv: Any, origin: Any, centre: Any, emit: Any, axis_x: Any,
    axis_y: Any, area: Any, shift_x: Any, shift_y: Any, rough: Any, derivatives: bool, specular: bool, shadows: bool,
) -> Any:  # fmt: skip
    """Sum over a light's samples (symbolic loop): see LightTerms for what each sum is."""
    diffuse, gloss = mi.Float(0), mi.Float(0)
    diffuse_n, gloss_n = mi.Vector3f(0), mi.Vector3f(0)
    diffuse_t, gloss_t, gloss_r = mi.Float(0), mi.Float(0), mi.Float(0)
    k = mi.UInt32(0)
    while k < samples:
        # The R2 lattice (Roberts 2018) fills the square evenly for every count.
        a = mi.Float(k) * 0.7548776662466927 + shift_x
        b = mi.Float(k) * 0.5698402909980532 + shift_y
        target = centre + axis_x * (a - dr.floor(a) - 0.5) + axis_y * (b - dr.floor(b) - 0.5)
        offset = target - x
        inverse = dr.rsqrt(dr.squared_norm(offset))
        light = offset * inverse
        nl = dr.dot(n, light)
        cosine = -dr.dot(emit, light)
        visible = (nl > 0) & (cosine > 0)
        if dr.hint(shadows, mode="scalar"):
            span = target - origin
            distance = dr.norm(span)
            ray = mi.Ray3f(origin, span / distance, distance * (1 - 1e-4), 0, [])
            visible &= ~scene.ray_test(ray, visible)
        w = dr.select(visible, area * cosine * dr.square(inverse), 0)
        diffuse += w * nl
        half = light + v
        half_inverse = dr.rsqrt(dr.maximum(dr.squared_norm(half), 1e-12))
        h = half * half_inverse
        nh = dr.maximum(dr.dot(n, h), 0)
        vh = dr.clip(dr.dot(v, h), 0, 1)
        lobe = specular_lobe(dr.maximum(nl, 0), nv, dr.squared_norm(dr.cross(n, h)), nh, vh, rough)
        if dr.hint(specular, mode="scalar"):
            gloss += w * lobe.value
        if dr.hint(derivatives, mode="scalar"):
            # Moving the point by dt along its view ray: dX = -v dt.
            w_t = dr.select(
                visible, area * dr.square(inverse) * inverse * (-dr.dot(emit, v) - 3 * cosine * dr.dot(light, v)), 0
            )
            light_t = (v - light * dr.dot(light, v)) * inverse
            nl_t = dr.dot(n, light_t)
            diffuse_n += w * light
            diffuse_t += w_t * nl + w * nl_t
            if dr.hint(specular, mode="scalar"):
                h_t = (light_t - h * dr.dot(h, light_t)) * half_inverse
                gloss_n += w * (light * lobe.by_nl + v * lobe.by_nv + h * lobe.by_nh)
                lobe_t = lobe.by_nl * nl_t + lobe.by_nh * dr.dot(n, h_t) + lobe.by_vh * dr.dot(v, h_t)
                gloss_t += w_t * lobe.value + w * lobe_t
                gloss_r += w * lobe.by_roughness
        k += 1
    return diffuse, gloss, diffuse_n, gloss_n, diffuse_t, gloss_t, gloss_r


def _vector(array: np.ndarray) -> mi.Vector3f:
    columns = np.ascontiguousarray(np.asarray(array, np.float32).T)
    return mi.Vector3f(mi.Float(columns[0]), mi.Float(columns[1]), mi.Float(columns[2]))


def hash_to_unit(key: mi.UInt32, salt: mi.UInt32) -> mi.Float:
    """A number in [0, 1) per lane that depends on nothing but its key and salt (TEA hash)."""
    return mi.sample_tea_float32(key, salt, 4)


def _empty(lights: int, derivatives: bool) -> LightTerms:
    scalar, vector = np.zeros((0, lights), np.float32), np.zeros((0, lights, 3), np.float32)
    if not derivatives:
        return LightTerms(scalar, scalar)
    return LightTerms(scalar, scalar, vector, vector, scalar, scalar, scalar)
