"""The light that reaches points from square lights: what :meth:`RayTracer.light_terms` runs.

A lane walks over some of the lights for one point: neighbouring lanes send near-parallel rays,
and sums over lights stay in registers. Structures whose fields the loops change or carry are
dataclasses, which Dr.Jit takes apart; those that it must leave alone (arrays to gather from and
scatter to, what was asked) are plain classes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from facestage.contract.light_stage import LightStage
from facestage.render.brdf import HalfVector, lobe_about
from facestage.render.light_terms import Asked

# The factor keeps the lights' random numbers apart.
LIGHT_SALT = 0x9E3779B1


@dataclass
class Lanes:
    """What each lane works on: a point, and where its lights begin among those that are traced."""

    point: Any  # UInt32
    first_light: Any  # UInt32
    x: Any  # Vector3f, like all below that are not said to be something else
    normal: Any
    view: Any
    view_cosine: Any  # Float
    origin: Any  # where shadow rays start
    key: Any  # UInt32, what the random numbers depend on
    roughness: Any  # Float


@dataclass
class Square:
    """One light per lane."""

    centre: Any  # Vector3f, like those to the radiance
    emit: Any
    axis_x: Any  # both sides as vectors
    axis_y: Any
    radiance: Any
    area: Any  # Float, per sample

    def at(self, a: Any, b: Any) -> Any:
        """The place at ``a`` and ``b`` of its sides, -0.5 to 0.5."""
        return self.centre + self.axis_x * a + self.axis_y * b

    def reaches(self, x: Any, normal: Any) -> Any:
        """Whether any of it lies before the plane at ``x``, and ``x`` on the side it emits to."""
        # The square's point farthest along the normal.
        half_width = dr.abs(dr.dot(normal, self.axis_x)) + dr.abs(dr.dot(normal, self.axis_y))
        reach = dr.dot(normal, self.centre - x) + 0.5 * half_width
        return (reach > 0) & (dr.dot(self.emit, x - self.centre) > 0)


class Squares:
    """The traced lights on the device."""

    def __init__(
        self,
        stage: LightStage,
        radiance: np.ndarray,
        traced: np.ndarray,
        numbers: np.ndarray,
        samples: int,
    ) -> None:
        """``traced`` (L,) int among the N lights; ``radiance`` (N, 3), ``numbers`` (N,)."""
        self._index = mi.UInt32(traced.astype(np.uint32))
        self._salt = mi.UInt32((numbers.astype(np.uint64) * LIGHT_SALT).astype(np.uint32))
        self._vectors = {
            "centre": floats(stage.position),
            "emit": floats(stage.direction),
            "axis_x": floats(stage.axis_x * stage.side[:, None]),
            "axis_y": floats(stage.axis_y * stage.side[:, None]),
            "radiance": floats(radiance),
        }
        self._area = floats(stage.side**2 / samples)
        # Opaque, like all counts and the seed: others must not compile another kernel.
        self.count = dr.opaque(mi.UInt32, len(traced))
        self.samples = dr.opaque(mi.UInt32, samples)

    def number(self, place: Any) -> Any:
        """Of the stage's lights, which one is at ``place`` among the traced ones."""
        return dr.gather(mi.UInt32, self._index, place)

    def salt(self, light: Any) -> Any:
        """What a light's random numbers depend on."""
        return dr.gather(mi.UInt32, self._salt, light)

    def of(self, light: Any) -> Square:
        """The lights numbered ``light`` of the stage."""
        vectors = {
            name: dr.gather(mi.Vector3f, array, light) for name, array in self._vectors.items()
        }
        return Square(**vectors, area=dr.gather(mi.Float, self._area, light))


class PerLight:
    """Where the kernel writes what it finds for each point and light; the rest stays zero."""

    def __init__(self, points: int, lights: int, specular: bool) -> None:
        self._shape = (lights, points)
        # One row for all that a lane's only light may be.
        self._row = dr.opaque(mi.UInt32, points if lights > 1 else 0)
        self._specular_asked = specular
        self.diffuse = dr.zeros(mi.Float, lights * points)
        self.specular = dr.zeros(mi.Float, lights * points if specular else 1)

    def write(self, found: FromLight, light: Any, point: Any) -> None:
        """Neighbouring lanes write to neighbouring places."""
        place = light * self._row + point
        dr.scatter(self.diffuse, found.diffuse, place)
        if self._specular_asked:
            dr.scatter(self.specular, found.specular, place)

    def arrays(self) -> tuple[np.ndarray, np.ndarray]:
        """Diffuse and specular terms (P, N)."""
        specular = np.broadcast_to(np.array(self.specular), len(self.diffuse))
        diffuse, specular = (
            array.reshape(self._shape).T for array in (np.array(self.diffuse), specular)
        )
        return diffuse, specular


@dataclass
class FromLight:
    """What a lane's point gets of one light at unit radiance, and how that changes."""

    diffuse: Any  # Float
    specular: Any  # Float
    diffuse_by_normal: Any  # Vector3f
    specular_by_normal: Any  # Vector3f
    diffuse_by_depth: Any  # Float
    specular_by_depth: Any  # Float
    specular_by_roughness: Any  # Float

    @classmethod
    def nothing(cls) -> FromLight:
        """All zero."""
        return cls(
            diffuse=mi.Float(0),
            specular=mi.Float(0),
            diffuse_by_normal=mi.Vector3f(0),
            specular_by_normal=mi.Vector3f(0),
            diffuse_by_depth=mi.Float(0),
            specular_by_depth=mi.Float(0),
            specular_by_roughness=mi.Float(0),
        )


@dataclass
class Sums:
    """The derivatives of a lane's lights times their radiance, and how many it worked on.

    By normal: one Vector3f for each color channel; the others: a Vector3f of the channels.
    """

    diffuse_by_normal: list[Any]
    specular_by_normal: list[Any]
    diffuse_by_depth: Any
    specular_by_depth: Any
    specular_by_roughness: Any
    pairs: Any  # UInt32

    @classmethod
    def nothing(cls) -> Sums:
        """All zero."""
        return cls(
            diffuse_by_normal=[mi.Vector3f(0) for _ in range(3)],
            specular_by_normal=[mi.Vector3f(0) for _ in range(3)],
            diffuse_by_depth=mi.Vector3f(0),
            specular_by_depth=mi.Vector3f(0),
            specular_by_roughness=mi.Vector3f(0),
            pairs=mi.UInt32(0),
        )

    def add(self, found: FromLight, radiance: Any, asked: Asked) -> None:
        """One more light."""
        if asked.by_surface:
            for channel in range(3):
                self.diffuse_by_normal[channel] += radiance[channel] * found.diffuse_by_normal
            self.diffuse_by_depth += radiance * found.diffuse_by_depth
        if asked.by_surface and asked.specular:
            for channel in range(3):
                self.specular_by_normal[channel] += radiance[channel] * found.specular_by_normal
            self.specular_by_depth += radiance * found.specular_by_depth
        if asked.by_roughness and asked.specular:
            self.specular_by_roughness += radiance * found.specular_by_roughness


class LightKernel:
    """Traces each lane's lights; one call of :meth:`sums` is one launch."""

    def __init__(self, scene: Any, squares: Squares, kept: PerLight, asked: Asked) -> None:
        """``kept`` is written to."""
        self._scene, self._squares, self._kept, self._asked = scene, squares, kept, asked

    @dr.syntax
    def sums(self, lanes: Lanes, each: Any, seed: Any) -> Sums:
        """Each lane's ``each`` lights and their samples, in symbolic loops."""
        total = Sums.nothing()
        i = mi.UInt32(0)
        while (i < each) & (lanes.first_light + i < self._squares.count):
            number = self._squares.number(lanes.first_light + i)
            square = self._squares.of(number)
            salt = self._squares.salt(number) + seed
            shift_x, shift_y = hash_to_unit(lanes.key, salt + 1), hash_to_unit(lanes.key, salt + 2)
            found = FromLight.nothing()
            front = mi.Bool(True)
            if dr.hint(not self._asked.behind, mode="scalar"):
                front = square.reaches(lanes.x, lanes.normal)
            total.pairs += dr.select(front, mi.UInt32(1), mi.UInt32(0))
            k = mi.UInt32(0)
            while front & (k < self._squares.samples):
                # The R2 lattice (Roberts 2018) fills the square evenly for every count.
                a = mi.Float(k) * 0.7548776662466927 + shift_x
                b = mi.Float(k) * 0.5698402909980532 + shift_y
                target = square.at(a - dr.floor(a) - 0.5, b - dr.floor(b) - 0.5)
                self._add_sample(found, lanes, square, target)
                k += 1
            self._kept.write(found, number, lanes.point)
            total.add(found, square.radiance, self._asked)
            i += 1
        return total

    def _add_sample(self, found: FromLight, lanes: Lanes, square: Square, target: Any) -> None:
        """Add to ``found`` what the point gets from the square's place ``target``."""
        asked, normal, view = self._asked, lanes.normal, lanes.view
        offset = target - lanes.x
        inverse = dr.rsqrt(dr.squared_norm(offset))
        light = offset * inverse
        nl = dr.dot(normal, light)
        cosine = -dr.dot(square.emit, light)
        visible = (nl > 0) & (cosine > 0)
        if asked.shadows:
            visible &= ~self._scene.ray_test(shadow_ray(lanes.origin, target), visible)
        w = dr.select(visible, square.area * cosine * dr.square(inverse), 0)
        found.diffuse += w * nl
        half = HalfVector.between(light, view)
        lobe = lobe_about(half, normal, view, nl, lanes.view_cosine, lanes.roughness)
        if asked.specular:
            found.specular += w * lobe.value
        if asked.specular and asked.by_roughness:
            found.specular_by_roughness += w * lobe.by_roughness
        if not asked.by_surface:
            return
        # Moving the point by dt along its view ray: dX = -v dt.
        turning = -dr.dot(square.emit, view) - 3 * cosine * dr.dot(light, view)
        w_t = dr.select(visible, square.area * dr.square(inverse) * inverse * turning, 0)
        light_t = (view - light * dr.dot(light, view)) * inverse
        nl_t = dr.dot(normal, light_t)
        found.diffuse_by_normal += w * light
        found.diffuse_by_depth += w_t * nl + w * nl_t
        if asked.specular:
            h = half.direction
            h_t = (light_t - h * dr.dot(h, light_t)) * half.inverse_length
            by_normal = light * lobe.by_nl + view * lobe.by_nv + h * lobe.by_nh
            lobe_t = lobe.by_nl * nl_t + lobe.by_nh * dr.dot(normal, h_t)
            lobe_t += lobe.by_vh * dr.dot(view, h_t)
            found.specular_by_normal += w * by_normal
            found.specular_by_depth += w_t * lobe.value + w * lobe_t


def shadow_ray(origin: Any, target: Any) -> Any:
    """A ray that ends just before ``target``."""
    span = target - origin
    distance = dr.norm(span)
    return mi.Ray3f(origin, span / distance, distance * (1 - 1e-4), 0, [])


def floats(array: np.ndarray) -> Any:
    """All numbers of ``array``, row by row, on the device."""
    return mi.Float(np.ascontiguousarray(array, np.float32).ravel())


def hash_to_unit(key: Any, salt: Any) -> Any:
    """A number in [0, 1) per lane that depends on nothing but its key and salt (TEA hash)."""
    return mi.sample_tea_float32(key, salt, 4)
