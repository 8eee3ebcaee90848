"""Primary visibility and light-by-light direct illumination with self-shadows, by ray tracing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from facestage.render.brdf import view_cosine
from facestage.render.light_kernel import Lanes, LightKernel, PerLight, Squares, Sums, floats
from facestage.render.light_terms import PLAIN, Asked, LightTerms, LitPoints
from facestage.render.variant import load_dict

# Shadow rays start this far off the surface (metres): facets of a smooth-shaded mesh must not
# shadow themselves, and nothing on a face that casts a shadow is thinner.
SHADOW_OFFSET = 2e-4
# Lanes of work that keep all cores busy.
LANES = 1 << 16


@dataclass(frozen=True)
class Hits:
    """What each of P rays hits first: triangle index (-1: nothing) and barycentric weights."""

    triangle: np.ndarray  # (P,) int32
    barycentric: np.ndarray  # (P, 3) float32


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
        self._places = start

    def update(self, vertices: np.ndarray) -> None:
        """Move the mesh to ``vertices`` (n, 3) metres."""
        places = np.array(vertices, np.float32).ravel()
        if np.array_equal(places, self._places):
            return  # what follows takes as long as rendering a small face
        self._scene_parameters["face.vertex_positions"] = mi.Float(places)
        self._scene_parameters.update()
        self._places = places

    @staticmethod
    def release() -> None:
        """Give back the memory that the renderer keeps for what it traces next."""
        dr.flush_malloc_cache()

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
        lit: LitPoints,
        samples: int,
        seed: int,
        asked: Asked = PLAIN,
        *,
        radiance: np.ndarray | None = None,
        traced: np.ndarray | None = None,
        pairs: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> LightTerms:
        """Direct illumination of each point by each light, at unit radiance.

        ``samples`` per light, stratified by a rank-1 lattice with a shift per point and light that
        depends on ``seed`` and the names of both alone. ``radiance`` (N, 3), the stage's own when
        None, is what derivatives are summed with. ``traced`` (N,) bool: the lights to work on; the
        others' terms are zero. ``pairs``: indices (K,) of points and (K,) of lights; only these are
        worked on, each on its own: the terms are those of K points and one light.
        """
        lights, index = len(lit.stage), np.arange(len(lit.stage))
        if pairs is not None:
            lit, lights = lit.part(pairs[0]), 1
        elif traced is not None:
            index = np.flatnonzero(traced)
        count = len(lit.points)
        if count == 0 or len(index) == 0:
            return LightTerms.dark(count, lights, asked)
        # Few points are split further, so that every core has lanes to work on.
        groups = 1 if pairs is not None else int(np.clip(self._lanes // count, 1, len(index)))
        each = dr.opaque(mi.UInt32, 1 if pairs is not None else -(-len(index) // groups))
        lane = dr.arange(mi.UInt32, count * groups)
        group = lane // dr.opaque(mi.UInt32, count)
        first = group * each if pairs is None else mi.UInt32(pairs[1].astype(np.uint32))
        lanes = _lanes(lit, lane - group * dr.opaque(mi.UInt32, count), first)
        light = lit.stage.radiance if radiance is None else radiance
        squares = Squares(lit.stage, light, index, lit.numbers, samples)
        kept = PerLight(count, lights, asked.specular)
        # Opaque: another seed must not compile another kernel.
        kernel = LightKernel(self.scene, squares, kept, asked)
        # Dr.Jit would run the body of each loop twice, to find what stays as it is: four times for
        # samples within lights, which takes a small picture longer than tracing it.
        with dr.scoped_set_flag(dr.JitFlag.OptimizeLoops, False):
            sums = kernel.sums(lanes, each, dr.opaque(mi.UInt32, 2 * seed))
        dr.eval(kept.diffuse, kept.specular, sums)
        return _terms(kept, sums, asked, count, count * groups)


def _lanes(lit: LitPoints, point: Any, first_light: Any) -> Lanes:
    """Lanes for the points numbered ``point``."""

    def gather(array: np.ndarray) -> Any:
        return dr.gather(mi.Vector3f, floats(array), point)

    x, normal, view = gather(lit.points), gather(lit.normals), gather(lit.views)
    rough = np.ravel(np.asarray(lit.roughness, np.float32))
    # One row for all points where they share it: the kernel is the same.
    rough_row = dr.opaque(mi.UInt32, 1 if len(rough) > 1 else 0)
    return Lanes(
        point,
        first_light,
        x,
        normal,
        view,
        view_cosine(normal, view),
        origin=x + SHADOW_OFFSET * gather(lit.facing),
        key=dr.gather(mi.UInt32, mi.UInt32(np.ascontiguousarray(lit.keys, np.uint32)), point),
        roughness=dr.gather(mi.Float, floats(rough), point * rough_row),
    )


def _terms(kept: PerLight, sums: Sums, asked: Asked, points: int, lanes: int) -> LightTerms:
    """What the kernel found, the lanes of a point put together."""

    def channels(values: Any) -> np.ndarray:
        """(P, 3) of a Vector3f over the lanes; a sum that was left out is a single zero."""
        each = [np.broadcast_to(np.array(v), lanes) for v in (values.x, values.y, values.z)]
        return np.stack([value.reshape(-1, points).sum(0) for value in each], axis=-1)

    terms = LightTerms(*kept.arrays(), pairs=int(np.array(sums.pairs).sum(dtype=np.int64)))
    if asked.by_surface:
        terms = replace(
            terms,
            diffuse_by_normal=np.stack([channels(each) for each in sums.diffuse_by_normal], axis=1),
            specular_by_normal=np.stack(
                [channels(each) for each in sums.specular_by_normal], axis=1
            ),
            diffuse_by_depth=channels(sums.diffuse_by_depth),
            specular_by_depth=channels(sums.specular_by_depth),
        )
    if asked.by_roughness:
        terms = replace(terms, specular_by_roughness=channels(sums.specular_by_roughness))
    return terms


def _vector(array: np.ndarray) -> mi.Vector3f:
    columns = np.ascontiguousarray(np.asarray(array, np.float32).T)
    return mi.Vector3f(mi.Float(columns[0]), mi.Float(columns[1]), mi.Float(columns[2]))
