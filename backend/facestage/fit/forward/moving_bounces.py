"""How light from skin to skin changes as the face changes its shape, turns, or takes other colors.

The light that falls on the patches changes as they turn, and so does what they send; and points see
more of the patches, or less, as both turn and come near. Which patch a ray meets is held fixed, as
the visibility of lights is: the ends of the rays move with the skin that they are on, and a ray's
share changes as (n.d)(m.d) / d^4 dA does (d: from end to end; n, m: the normals there).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy.sparse as sp

from facestage.contract import brdf
from facestage.contract.arrays import Float, Float32, Int
from facestage.contract.light_stage import LightStage
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.forward.bounces import LIGHT_SAMPLES, RAYS, Bounces, SkinHits, sent_on
from facestage.fit.forward.reflectance import albedo_of, by_log
from facestage.fit.forward.shading import ForwardModel, Image
from facestage.render.light_terms import Asked, LightTerms, LitPoints

# A ray's share changes without bound where the ray grazes the skin or is short: no more than at
# this cosine and length, by which few rays come nearest to what many that are traced anew say.
COSINE_MIN, LENGTH_MIN = 0.2, 4e-3  # , m


@dataclass(frozen=True)
class DirectChange:
    """How direct light on the points changes, in each channel under all lights together."""

    by_normal: Float32[np.ndarray, "3 points 3"]  # model frame
    by_place: Float32[np.ndarray, "3 points 3"]
    by_pose: Float32[np.ndarray, "3 points 6"]  # rotation about the tracer's origin, translation

    @classmethod
    def of(cls, terms: LightTerms, lit: LitPoints, rotation: Float[np.ndarray, "3 3"]) -> Self:
        """``rotation`` from the model's frame to that of ``lit``."""
        # Along the points' normals, where the tracer's viewer is.
        place = -terms.diffuse_by_depth[..., None] * lit.normals[:, None]
        turn = np.cross(lit.normals[:, None], terms.diffuse_by_normal)
        turn += np.cross(lit.points[:, None], place)
        changes = (
            terms.diffuse_by_normal @ rotation,
            place @ rotation,
            np.concatenate([turn, place], axis=2),
        )
        return cls(*(each.transpose(1, 0, 2).astype(np.float32) for each in changes))

    def along(self, motion: Motion) -> Float32[np.ndarray, "3 points modes"]:
        """By the modes of a motion."""
        change = np.einsum("cpx,pxm->cpm", self.by_normal, motion.normals, optimize=True)
        change += np.einsum("cpx,pxm->cpm", self.by_place, motion.places, optimize=True)
        return change


@dataclass(frozen=True)
class MovingBounces:
    """What the points receive from other skin, under all lights together at the state's strength,
    and how it changes.
    """

    bounces: Bounces
    strength: float
    received: Float32[np.ndarray, "3 points"]
    onward: Float32[np.ndarray, "3 points patches"]  # received, by what falls on the patches
    views: Views
    # (points, hits) for each channel: what the points receive along the rays that met skin.
    rays: tuple[sp.csr_matrix, ...]
    direct: DirectChange
    # What would have to fall on the patches to change what they send as their log albedo does.
    by_log_albedo: Float[np.ndarray, "3 patches"]

    def at_vertices(self, points: Float[np.ndarray, "3 points"]) -> Float[np.ndarray, "vertices 3"]:
        """What the vertices take of the ``points`` around them."""
        return self.strength * (self.bounces.spread @ points.T)

    def by_shape(
        self, basis: Float32[np.ndarray, "coordinates modes"], some: Int[np.ndarray, " _"]
    ) -> Float32[np.ndarray, "3 _ modes"]:
        """What ``some`` vertices receive, by the weights of the modes of ``basis``."""
        motion = self.views.turning.motion(basis)
        shares = self.views.changes(basis, motion)
        seen = np.stack([ray @ shares for ray in self.rays])
        return self._spread(some, seen + self.direct.along(motion), seen)

    def by_pose(self, some: Int[np.ndarray, " _"]) -> Float32[np.ndarray, "3 _ 6"]:
        """What ``some`` vertices receive, by rotation about the model's origin and translation."""
        return self._spread(some, self.direct.by_pose)

    def by_albedo(
        self, modes: Float32[np.ndarray, "3 vertices albedos"], some: Int[np.ndarray, " _"]
    ) -> Float32[np.ndarray, "3 _ albedos"]:
        """What ``some`` vertices receive, by the weights of modes of the log albedo."""
        by_point = modes[:, self.bounces.points]
        return self._spread(some, by_point, by_log_albedo=self.by_log_albedo)

    def _spread(
        self,
        some: Int[np.ndarray, " _"],
        fallen: Float32[np.ndarray, "3 points changes"],
        seen: Float32[np.ndarray, "3 points changes"] | None = None,
        by_log_albedo: Float[np.ndarray, "3 patches"] | None = None,
    ) -> Float32[np.ndarray, "3 _ changes"]:
        """What reaches ``some`` vertices of what has ``fallen`` on the points and is sent on, and
        of what they have ``seen`` besides.
        """
        spread = np.float32(self.strength) * self.bounces.spread[some]
        taken = np.unique(spread.indices)
        spread = spread[:, taken]
        members = self.bounces.members.astype(np.float32)
        result = []
        for channel, onward in enumerate(self.onward):
            patches = members @ fallen[channel]
            if by_log_albedo is not None:
                patches *= by_log_albedo[channel, :, None].astype(np.float32)
            points = onward[taken] @ patches
            if seen is not None:
                points += seen[channel, taken]
            result.append(spread @ points)
        return np.stack(result)


def moving_bounces(
    forward: ForwardModel, state: State, image: Image, stage: LightStage, seed: int
) -> MovingBounces | None:
    """Of an ``image`` under ``stage`` (camera frame) that was lit with ``seed``; None: no skin
    lights skin, or which does is held.
    """
    bounces, surface = forward.bounces, image.surface
    if not image.terms.indirect.size or bounces.resting:
        return None
    centred = forward.lit_points(state, surface, stage)
    vertices = surface.vertices - state.translation
    lit = bounces.lit_points(vertices, centred.stage, centred.numbers)
    forward.tracer.update(vertices)
    terms = forward.tracer.light_terms(
        lit,
        LIGHT_SAMPLES,
        seed,
        Asked(specular=False, by_surface=True),
        radiance=image.radiance,
        traced=image.terms.indirect.any(axis=(0, 1)),
    )
    hits = bounces.seen(forward.tracer, vertices, lit)
    factors = bounces.form_factors(hits)
    between, members = bounces.members @ factors, bounces.members
    logs = forward.log_albedo(state)
    share = bounces.share(logs, float(state.specular.mean())).T
    one = np.eye(share.shape[1], dtype=np.float32)
    onward = np.stack([factors @ sent_on(between, each, one) for each in share])
    fallen = (members @ (terms.diffuse @ image.radiance)).T[..., None]
    sent = np.stack(
        [sent_on(between, each, light)[:, 0] for each, light in zip(share, fallen, strict=True)]
    )
    turning = Turning(
        forward.geometry,
        surface.model_vertices,
        bounces.points,
        surface.model_normals,
        surface.normal_scale,
    )
    patch = bounces.patch_of_triangle[hits.triangle]
    met = (hits.point, np.arange(len(patch)))
    shape = (len(bounces.points), len(patch))
    albedo = albedo_of(members @ logs[bounces.points]).T
    return MovingBounces(
        bounces,
        state.interreflection,
        np.stack([factors @ each for each in sent]).astype(np.float32),
        onward.astype(np.float32),
        Views.of(turning, hits),
        tuple(
            sp.csr_matrix(((each[patch] / RAYS).astype(np.float32), met), shape) for each in sent
        ),
        DirectChange.of(terms, lit, state.rotation),
        by_log(brdf.matte(np.pi, np.ones_like(albedo)), albedo) * sent / share**2,
    )


@dataclass(frozen=True)
class Motion:
    """How the points move by the weights of modes, and how their unit normals turn."""

    places: Float32[np.ndarray, "points 3 modes"]
    normals: Float32[np.ndarray, "points 3 modes"]


class Turning:
    """Some vertices of a mesh, and how their normals turn as it changes its shape."""

    def __init__(
        self,
        geometry: FaceGeometry,
        vertices: Float[np.ndarray, "vertices 3"],
        points: Int[np.ndarray, " points"],
        normals: Float[np.ndarray, "vertices 3"],
        lengths: Float[np.ndarray, " vertices"],
    ) -> None:
        """``points`` are some of the vertices; ``normals`` are unit, ``lengths`` those before."""
        self.geometry, self.vertices, self.points = geometry, vertices, points
        wanted = np.zeros(len(self.vertices), bool)
        wanted[points] = True
        self._operator = geometry.normal_operator(self.vertices, wanted)
        self._row = (np.cumsum(wanted) - 1)[points]
        self.normals, self._lengths = normals[points], lengths[points]

    def motion(self, basis: Float32[np.ndarray, "coordinates modes"]) -> Motion:
        """By the modes of ``basis``, of all vertices."""
        modes = basis.shape[1]
        turned = (self._operator @ basis).reshape(-1, 3, modes)[self._row]
        unit = self.normals.astype(np.float32)
        turned -= unit[..., None] * np.einsum("px,pxm->pm", unit, turned)[:, None]
        turned /= np.maximum(self._lengths, 1e-20).astype(np.float32)[:, None, None]
        return Motion(basis.reshape(-1, 3, modes)[self.points], turned)


@dataclass(frozen=True)
class Views:
    """How the share of each ray that met skin changes, as a share of itself."""

    turning: Turning
    hits: SkinHits
    by_normal: Float[np.ndarray, "hits 3"]  # of the point
    by_place: Float[np.ndarray, "hits 4 3"]  # of the point and of the corners that the ray met

    @classmethod
    def of(cls, turning: Turning, hits: SkinHits) -> Views:
        """Of the rays of the points of ``turning``."""
        corners = turning.geometry.triangles[hits.triangle]
        a, b, c = (turning.vertices[corners[:, each]] for each in range(3))
        way = np.einsum("hi,hix->hx", hits.barycentric, turning.vertices[corners])
        way -= turning.vertices[turning.points[hits.point]]
        length = np.maximum(np.linalg.norm(way, axis=1, keepdims=True), LENGTH_MIN)
        normal, area = turning.normals[hits.point], np.cross(b - a, c - a)
        size = np.linalg.norm(area, axis=1, keepdims=True)
        here = np.maximum((normal * way).sum(1, keepdims=True), COSINE_MIN * length)
        there = (area * way).sum(1, keepdims=True)
        there = np.where(there < 0, -1, 1) * np.maximum(np.abs(there), COSINE_MIN * length * size)
        by_way = normal / here + area / there - 4 * way / length**2
        by_area = way / there
        by_corner = hits.barycentric[..., None] * by_way[:, None]
        by_corner += np.cross(np.stack([b - c, c - a, a - b], axis=1), by_area[:, None])
        return cls(turning, hits, way / here, np.concatenate([-by_way[:, None], by_corner], axis=1))

    def changes(
        self, basis: Float32[np.ndarray, "coordinates modes"], motion: Motion
    ) -> Float32[np.ndarray, "hits modes"]:
        """By the modes of ``basis``; ``motion`` is that of the points by them."""
        corners = self.turning.geometry.triangles[self.hits.triangle]
        moved = np.concatenate([self.turning.points[self.hits.point, None], corners], axis=1)
        change = _each(moved, self.by_place, len(basis)) @ basis
        normals = motion.normals.reshape(-1, basis.shape[1])
        change += _each(self.hits.point[:, None], self.by_normal[:, None], len(normals)) @ normals
        return change


def _each(
    index: Int[np.ndarray, "rows entries"], by: Float[np.ndarray, "rows entries 3"], width: int
) -> sp.csr_matrix:
    """(rows, width) that takes of the vectors of ``index`` in each row what ``by`` says."""
    columns = (3 * index[..., None] + np.arange(3)).astype(np.int32)
    pointer = np.arange(0, columns.size + 1, 3 * index.shape[1])
    values = by.astype(np.float32).ravel()
    return sp.csr_matrix((values, columns.ravel(), pointer), (len(index), width))
