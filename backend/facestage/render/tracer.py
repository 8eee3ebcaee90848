"""Primary visibility and light-by-light direct illumination with self-shadows, by ray tracing."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from facestage.contract.light_stage import LightStage
from facestage.render.brdf import specular_lobe, view_cosine
from facestage.render.variant import load_dict

# Shadow rays start this far off the surface (metres): facets of a smooth-shaded mesh must not
# shadow themselves, and nothing on a face that casts a shadow is thinner.
SHADOW_OFFSET = 2e-4
LIGHT_SALT = 0x9E3779B1
# Lanes of work that keep all cores busy.
LANES = 1 << 16


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
    (n.l) D V F. The derivatives are summed over the lights at the radiance that was given, one row
    per color channel, and keep the visibility fixed; ``*_by_depth`` moves the point along its view
    ray (away from the camera, per metre); they are empty unless asked for.
    """

    diffuse: np.ndarray  # (P, N)
    specular: np.ndarray  # (P, N), zero where it was left out
    diffuse_by_normal: np.ndarray = field(default_factory=_not_asked)  # (P, 3 channels, 3)
    specular_by_normal: np.ndarray = field(default_factory=_not_asked)  # (P, 3 channels, 3)
    diffuse_by_depth: np.ndarray = field(default_factory=_not_asked)  # (P, 3 channels)
    specular_by_depth: np.ndarray = field(default_factory=_not_asked)  # (P, 3 channels)
    specular_by_roughness: np.ndarray = field(default_factory=_not_asked)  # (P, 3 channels)
    pairs: int = 0  # of point and light that were worked on


@dataclass(frozen=True)
class Asked:
    """What of the light terms is wanted: the rest costs nothing and is zero, or empty."""

    specular: bool = True
    shadows: bool = True
    by_surface: bool = False  # derivatives by normal and depth
    by_roughness: bool = False
    # also work on lights that lie behind a point's normal: they add exactly nothing
    behind: bool = False


PLAIN = Asked()


class RayTracer:
    """A triangle mesh that rays can hit.

    The frame is the caller's; keep its origin near the face.
    """

    def __init__(self, triangles: np.ndarray, vertex_count: int, lanes: int = LANES) -> None:
        """``triangles`` (t, 3) int; positions come with :meth:`update`.

        ``lanes``: at least so many work at a time.
        """
        self._lanes = lanes
        self._mesh = mi.Mesh("face", vertex_count=vertex_count, face_count=len(triangles))
        self._parameters = mi.traverse(self._mesh)
        self._parameters["faces"] = mi.UInt32(np.ascontiguousarray(triangles, np.uint32).ravel())
        # Degenerate starting positions would break the acceleration structure: spread them a
        # little.
        start = np.linspace(0.0, 1.0, vertex_count * 3, dtype=np.float32)
        self._parameters["vertex_positions"] = mi.Float(start)
        self._parameters.update()
        self.scene = load_dict({"type": "scene", "face": self._mesh})
        self._scene_parameters = mi.traverse(self.scene)

    def update(self, vertices: np.ndarray) -> None:
        """Move the mesh to ``vertices`` (n, 3) metres."""
        self._scene_parameters["face.vertex_positions"] = mi.Float(
            np.ascontiguousarray(vertices, np.float32).ravel()
        )
        self._scene_parameters.update()

    def first_hits(self, origin: np.ndarray, directions: np.ndarray) -> Hits:
        """First triangle along unit ``directions`` (P, 3) from ``origin`` (3,) or (P, 3)."""
        if len(directions) == 0:
            # A trace of no ray at all aborts the process inside Dr.Jit.
            return Hits(np.zeros(0, np.int32), np.zeros((0, 3), np.float32))
        ray = mi.Ray3f(
            mi.Point3f(_vector(np.broadcast_to(origin, directions.shape))), _vector(directions)
        )
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
        roughness: float | np.ndarray,
        samples: int,
        seed: int,
        asked: Asked = PLAIN,
        radiance: np.ndarray | None = None,
        traced: np.ndarray | None = None,
        keys: np.ndarray | None = None,
        numbers: np.ndarray | None = None,
        pairs: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> LightTerms:
        """Direct illumination of ``points`` (P, 3) by each light of ``stage`` (same frame, unit
        radiance).

        ``normals`` (P, 3) are the shading normals, ``facing`` (P, 3) the geometric ones on the
        viewer's side, ``views`` (P, 3) unit vectors towards the camera. ``roughness`` is one value
        or (P,). ``samples`` per light, stratified by a rank-1 lattice with a shift per point and
        light that depends on ``seed`` and the point's key alone. ``radiance`` (N, 3), the stage's
        own when None, is what derivatives are summed with. ``traced`` (N,) bool: the lights to work
        on; the others' terms are zero. ``keys`` (P,) int, by default 0, 1, 2, ...: give what names
        a point across calls, such as its pixel, so that it keeps its random numbers when other
        points come or go (common random numbers). ``numbers`` (N,) int, by default 0, 1, 2, ..., do
        the same for the lights. ``pairs``: indices (K,) of points and (K,) of lights; only these
        are worked on, each on its own: the terms are those of K points and one light.
        """
        names = np.arange(len(points)) if keys is None else keys
        lights, index = len(stage), np.arange(len(stage))
        if pairs is not None:
            points, normals, facing, views, names = (
                array[pairs[0]] for array in (points, normals, facing, views, names)
            )
            roughness = (
                roughness[pairs[0]]
                if isinstance(roughness, np.ndarray) and roughness.ndim
                else roughness
            )
            lights = 1
        elif traced is not None:
            index = np.flatnonzero(traced)
        count = len(points)
        if count == 0 or len(index) == 0:
            return _empty(count, lights, asked)
        # A lane walks over some of the lights for one point: neighbouring lanes send near-parallel
        # rays, and sums over lights stay in registers. Few points are split further, so that every
        # core has lanes to work on.
        groups = 1 if pairs is not None else int(np.clip(self._lanes // count, 1, len(index)))
        each = 1 if pairs is not None else -(-len(index) // groups)
        lane = dr.arange(mi.UInt32, count * groups)
        width = dr.opaque(mi.UInt32, count)
        group = lane // width
        point = lane - group * width

        def gather(array: np.ndarray) -> mi.Vector3f:
            return dr.gather(mi.Vector3f, _floats(array), point)

        x, n, v = gather(points), gather(normals), gather(views)
        origin = x + SHADOW_OFFSET * gather(facing)
        first = (
            group * dr.opaque(mi.UInt32, each)
            if pairs is None
            else mi.UInt32(pairs[1].astype(np.uint32))
        )
        rough = np.ravel(np.asarray(roughness, np.float32))
        # One row for all points where they share it: the kernel is the same.
        rough_row = dr.opaque(mi.UInt32, 1 if len(rough) > 1 else 0)
        squares = _Squares(
            stage,
            stage.radiance if radiance is None else radiance,
            index,
            samples,
            np.arange(len(stage)) if numbers is None else numbers,
        )
        kept = _PerLight(count, lights, asked.specular)
        sums = _accumulate(
            self.scene,
            squares,
            kept,
            first,
            dr.opaque(mi.UInt32, each),
            dr.opaque(mi.UInt32, len(index)),
            dr.opaque(mi.UInt32, samples),
            point,
            x,
            n,
            v,
            view_cosine(n, v),
            origin,
            dr.gather(mi.UInt32, mi.UInt32(np.ascontiguousarray(names, np.uint32)), point),
            # Opaque: another seed must not compile another kernel.
            dr.opaque(mi.UInt32, 2 * seed),
            dr.gather(mi.Float, _floats(rough), point * rough_row),
            asked.specular,
            asked.shadows,
            asked.by_surface,
            asked.by_roughness and asked.specular,
            asked.behind,
        )
        dr.eval(kept.diffuse, kept.specular, *sums)

        def scalar(value: mi.Float) -> np.ndarray:
            # A sum that was left out is a single zero.
            return np.broadcast_to(np.array(value), count * groups).reshape(groups, count).sum(0)

        def channels(values: Any) -> np.ndarray:
            return np.stack([scalar(value) for value in values], axis=-1)

        def vectors(values: Any) -> np.ndarray:
            return np.stack([channels((value.x, value.y, value.z)) for value in values], axis=1)

        terms = LightTerms(*kept.arrays(), pairs=int(np.array(sums[15]).sum(dtype=np.int64)))
        if asked.by_surface:
            terms = replace(
                terms,
                diffuse_by_normal=vectors(sums[0:3]),
                specular_by_normal=vectors(sums[3:6]),
                diffuse_by_depth=channels(sums[6:9]),
                specular_by_depth=channels(sums[9:12]),
            )
        if asked.by_roughness:
            terms = replace(terms, specular_by_roughness=channels(sums[12:15]))
        return terms


class _Squares:
    """The traced lights on the device.

    No dataclass: Dr.Jit would take it apart as a loop variable.
    """

    def __init__(
        self,
        stage: LightStage,
        radiance: np.ndarray,
        traced: np.ndarray,
        samples: int,
        numbers: np.ndarray,
    ) -> None:
        self.index = mi.UInt32(traced.astype(np.uint32))
        # The factor keeps the lights' random numbers apart.
        self._salt = mi.UInt32((numbers.astype(np.uint64) * LIGHT_SALT).astype(np.uint32))
        self._vectors = [
            _floats(array)
            for array in (
                stage.position,
                stage.direction,
                stage.axis_x * stage.side[:, None],
                stage.axis_y * stage.side[:, None],
                radiance,
            )
        ]
        self._area = _floats(stage.side**2 / samples)

    def salt(self, light: mi.UInt32) -> mi.UInt32:
        """What a light's random numbers depend on."""
        return dr.gather(mi.UInt32, self._salt, light)

    def at(self, light: mi.UInt32) -> tuple[Any, ...]:
        """Centre, emitting direction, both sides as vectors, radiance, and area per sample."""
        vectors = tuple(dr.gather(mi.Vector3f, array, light) for array in self._vectors)
        return *vectors, dr.gather(mi.Float, self._area, light)


class _PerLight:
    """Where the kernel writes what it finds for each point and light; the rest stays zero."""

    def __init__(self, points: int, lights: int, specular: bool) -> None:
        self._shape = (lights, points)
        # One row for all that a lane's only light may be.
        self._row = dr.opaque(mi.UInt32, points if lights > 1 else 0)
        self.diffuse = dr.zeros(mi.Float, lights * points)
        self.specular = dr.zeros(mi.Float, lights * points if specular else 1)

    def write(self, target: mi.Float, value: mi.Float, light: mi.UInt32, point: mi.UInt32) -> None:
        """Neighbouring lanes write to neighbouring places."""
        dr.scatter(target, value, light * self._row + point)

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Diffuse and specular terms (P, N)."""
        both = (np.array(self.diffuse), np.broadcast_to(np.array(self.specular), len(self.diffuse)))
        diffuse, specular = (array.reshape(self._shape).T for array in both)
        return diffuse, specular


@dr.syntax
def _accumulate(
    scene: Any,
    squares: _Squares,
    kept: _PerLight,
    first: Any,
    each: Any,
    count: Any,
    samples: Any,
    point: Any,
    x: Any,
    n: Any,
    v: Any,
    nv: Any,
    origin: Any,
    key: Any,
    seed: Any,
    rough: Any,
    specular: bool,
    shadows: bool,
    by_surface: bool,
    by_roughness: bool,
    behind: bool,
) -> Any:
    """Each lane's lights and their samples (symbolic loops); see LightTerms for what the sums
    are.
    """
    red_n, green_n, blue_n = mi.Vector3f(0), mi.Vector3f(0), mi.Vector3f(0)
    red_gloss_n, green_gloss_n, blue_gloss_n = mi.Vector3f(0), mi.Vector3f(0), mi.Vector3f(0)
    sum_t, sum_gloss_t, sum_r = mi.Vector3f(0), mi.Vector3f(0), mi.Vector3f(0)
    pairs = mi.UInt32(0)
    i = mi.UInt32(0)
    while (i < each) & (first + i < count):
        number = dr.gather(mi.UInt32, squares.index, first + i)
        centre, emit, axis_x, axis_y, radiance, area = squares.at(number)
        salt = squares.salt(number) + seed
        shift_x, shift_y = hash_to_unit(key, salt + 1), hash_to_unit(key, salt + 2)
        diffuse, gloss = mi.Float(0), mi.Float(0)
        diffuse_n, gloss_n = mi.Vector3f(0), mi.Vector3f(0)
        diffuse_t, gloss_t, gloss_r = mi.Float(0), mi.Float(0), mi.Float(0)
        front = mi.Bool(True)
        if dr.hint(not behind, mode="scalar"):
            # The square's point farthest along the normal, and the side that it emits to.
            reach = dr.dot(n, centre - x) + 0.5 * (
                dr.abs(dr.dot(n, axis_x)) + dr.abs(dr.dot(n, axis_y))
            )
            front = (reach > 0) & (dr.dot(emit, x - centre) > 0)
        pairs += dr.select(front, mi.UInt32(1), mi.UInt32(0))
        k = mi.UInt32(0)
        while front & (k < samples):
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
            lobe = specular_lobe(
                dr.maximum(nl, 0), nv, dr.squared_norm(dr.cross(n, h)), nh, vh, rough
            )
            if dr.hint(specular, mode="scalar"):
                gloss += w * lobe.value
                if dr.hint(by_roughness, mode="scalar"):
                    gloss_r += w * lobe.by_roughness
            if dr.hint(by_surface, mode="scalar"):
                # Moving the point by dt along its view ray: dX = -v dt.
                w_t = dr.select(
                    visible,
                    area
                    * dr.square(inverse)
                    * inverse
                    * (-dr.dot(emit, v) - 3 * cosine * dr.dot(light, v)),
                    0,
                )
                light_t = (v - light * dr.dot(light, v)) * inverse
                nl_t = dr.dot(n, light_t)
                diffuse_n += w * light
                diffuse_t += w_t * nl + w * nl_t
                if dr.hint(specular, mode="scalar"):
                    h_t = (light_t - h * dr.dot(h, light_t)) * half_inverse
                    gloss_n += w * (light * lobe.by_nl + v * lobe.by_nv + h * lobe.by_nh)
                    lobe_t = (
                        lobe.by_nl * nl_t
                        + lobe.by_nh * dr.dot(n, h_t)
                        + lobe.by_vh * dr.dot(v, h_t)
                    )
                    gloss_t += w_t * lobe.value + w * lobe_t
            k += 1
        kept.write(kept.diffuse, diffuse, number, point)
        if dr.hint(specular, mode="scalar"):
            kept.write(kept.specular, gloss, number, point)
        if dr.hint(by_surface, mode="scalar"):
            red_n += radiance.x * diffuse_n
            green_n += radiance.y * diffuse_n
            blue_n += radiance.z * diffuse_n
            sum_t += radiance * diffuse_t
            if dr.hint(specular, mode="scalar"):
                red_gloss_n += radiance.x * gloss_n
                green_gloss_n += radiance.y * gloss_n
                blue_gloss_n += radiance.z * gloss_n
                sum_gloss_t += radiance * gloss_t
        if dr.hint(by_roughness, mode="scalar"):
            sum_r += radiance * gloss_r
        i += 1
    return (
        red_n,
        green_n,
        blue_n,
        red_gloss_n,
        green_gloss_n,
        blue_gloss_n,
        sum_t.x,
        sum_t.y,
        sum_t.z,
        sum_gloss_t.x,
        sum_gloss_t.y,
        sum_gloss_t.z,
        sum_r.x,
        sum_r.y,
        sum_r.z,
        pairs,
    )


def _floats(array: np.ndarray) -> mi.Float:
    return mi.Float(np.ascontiguousarray(array, np.float32).ravel())


def _vector(array: np.ndarray) -> mi.Vector3f:
    columns = np.ascontiguousarray(np.asarray(array, np.float32).T)
    return mi.Vector3f(mi.Float(columns[0]), mi.Float(columns[1]), mi.Float(columns[2]))


def hash_to_unit(key: mi.UInt32, salt: mi.UInt32) -> mi.Float:
    """A number in [0, 1) per lane that depends on nothing but its key and salt (TEA hash)."""
    return mi.sample_tea_float32(key, salt, 4)


def _empty(points: int, lights: int, asked: Asked) -> LightTerms:
    """Terms of no point, or of no light."""
    dark, channels = np.zeros((points, lights), np.float32), np.zeros((points, 3), np.float32)
    terms = LightTerms(dark, dark)
    if asked.by_surface:
        vectors = np.zeros((points, 3, 3), np.float32)
        terms = replace(
            terms,
            diffuse_by_normal=vectors,
            specular_by_normal=vectors,
            diffuse_by_depth=channels,
            specular_by_depth=channels,
        )
    return replace(terms, specular_by_roughness=channels) if asked.by_roughness else terms
