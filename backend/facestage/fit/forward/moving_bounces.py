"""How light from skin to skin changes as the face changes its shape, turns, or takes other colors.

The light that falls on the patches changes as they turn, and so does what they send; and points see
more of the patches, or less, as both turn and come near. Which patch a ray meets is held fixed, as
the visibility of lights is: the ends of the rays move with the skin that they are on, and a ray's
share changes as (n.d)(m.d) / d^4 dA does (d: from end to end; n, m: the normals there).
"""

from __future__ import annotations

from dataclasses import dataclass

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
class MovingBounces:
    """What the points receive from other skin, under all lights together at the state's strength,
    and how it changes.
    """

    bounces: Bounces
    strength: float
    received: Float32[np.ndarray, "3 points"]
    onward: Float32[np.ndarray, "3 points patches"]  # received, by what falls on the patches
    # For each channel by the places of the vertices, in the model's frame (points, 3 vertices):
    seen: tuple[sp.csr_matrix, ...]  # received, as form factors change
    lit: tuple[sp.csr_matrix, ...]  # direct light
    turned: Float32[np.ndarray, "3 points 6"]  # direct light by rotation, then translation
    # What would have to fall on the patches to change what they send as their log albedo does.
    by_log_albedo: Float[np.ndarray, "3 patches"]

    def at_vertices(self, points: Float[np.ndarray, "3 points"]) -> Float[np.ndarray, "vertices 3"]:
        """What the vertices take of the ``points`` around them."""
        return self.strength * (self.bounces.spread @ points.T)

    def by_shape(
        self, basis: Float32[np.ndarray, "coordinates modes"], some: Int[np.ndarray, " _"]
    ) -> Float32[np.ndarray, "3 _ modes"]:
        """What ``some`` vertices receive, by the weights of the modes of ``basis``."""
        changes = []
        for by_view, by_light, onward in zip(self.seen, self.lit, self.onward, strict=True):
            seen = by_view @ basis
            changes.append(seen + onward @ (self.bounces.members @ (seen + by_light @ basis)))
        return self._spread(some, changes)

    def by_pose(self, some: Int[np.ndarray, " _"]) -> Float32[np.ndarray, "3 _ 6"]:
        """What ``some`` vertices receive, by rotation about the model's origin and translation."""
        members = self.bounces.members
        return self._spread(
            some,
            [
                onward @ (members @ turned)
                for onward, turned in zip(self.onward, self.turned, strict=True)
            ],
        )

    def by_albedo(
        self, modes: Float32[np.ndarray, "3 vertices albedos"], some: Int[np.ndarray, " _"]
    ) -> Float32[np.ndarray, "3 _ albedos"]:
        """What ``some`` vertices receive, by the weights of modes of the log albedo."""
        members, points = self.bounces.members, self.bounces.points
        return self._spread(
            some,
            [
                onward @ (by_log[:, None] * (members @ mode[points]))
                for onward, by_log, mode in zip(self.onward, self.by_log_albedo, modes, strict=True)
            ],
        )

    def _spread(
        self, some: Int[np.ndarray, " _"], points: list[Float[np.ndarray, "points changes"]]
    ) -> Float32[np.ndarray, "3 _ changes"]:
        spread = np.float32(self.strength) * self.bounces.spread[some]
        return np.stack([spread @ each.astype(np.float32) for each in points])


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
    hits = bounces.hits(forward.tracer, lit.points, lit.normals)
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
    turning = Turning(forward.geometry, surface.model_vertices, bounces.points)
    by_view = Views.of(turning, hits).changes(sent, bounces.patch_of_triangle[hits.triangle])
    albedo = albedo_of(members @ logs[bounces.points]).T
    return MovingBounces(
        bounces,
        state.interreflection,
        np.stack([factors @ each for each in sent]).astype(np.float32),
        onward.astype(np.float32),
        by_view,
        _by_light(turning, terms, lit, state),
        _by_pose(terms, lit),
        by_log(brdf.matte(np.pi, np.ones_like(albedo)), albedo) * sent / share**2,
    )


def _toward_tracer(terms: LightTerms, lit: LitPoints) -> Float[np.ndarray, "points 3 3"]:
    """Direct light by the points' places, along their normals: there the tracer's viewer is."""
    return -terms.diffuse_by_depth[..., None] * lit.normals[:, None]


def _by_light(
    turning: Turning, terms: LightTerms, lit: LitPoints, state: State
) -> tuple[sp.csr_matrix, ...]:
    """(points, 3 vertices) for each channel, direct light by the places of the vertices."""
    by_normal = (terms.diffuse_by_normal @ state.rotation).transpose(1, 0, 2)
    by_place = (_toward_tracer(terms, lit) @ state.rotation).transpose(1, 0, 2)
    return tuple(turning.changes(*each) for each in zip(by_normal, by_place, strict=True))


def _by_pose(terms: LightTerms, lit: LitPoints) -> Float32[np.ndarray, "3 points 6"]:
    """Direct light by rotation about the tracer's origin, then translation."""
    shift = _toward_tracer(terms, lit)
    turn = np.cross(lit.normals[:, None], terms.diffuse_by_normal)
    turn += np.cross(lit.points[:, None], shift)
    return np.concatenate([turn, shift], axis=2).transpose(1, 0, 2).astype(np.float32)


class Turning:
    """How values at points change that hang on the points' unit normals and places."""

    def __init__(
        self,
        geometry: FaceGeometry,
        vertices: Float[np.ndarray, "vertices 3"],
        points: Int[np.ndarray, " points"],
    ) -> None:
        """``points`` are some of the ``vertices``."""
        self.geometry, self.vertices, self.points = geometry, vertices, points
        wanted = np.zeros(len(vertices), bool)
        wanted[points] = True
        self._operator = geometry.normal_operator(vertices, wanted)
        self._row = (np.cumsum(wanted) - 1)[points]
        normals, lengths = geometry.vertex_normals(vertices)
        self.normals, self._lengths = normals[points], lengths[points]

    def changes(
        self,
        by_normal: Float[np.ndarray, "points 3"],
        by_place: Float[np.ndarray, "points 3"] | None = None,
    ) -> sp.csr_matrix:
        """(points, 3 vertices) by the places of the vertices."""
        along = np.einsum("px,px->p", by_normal, self.normals)
        turned = by_normal - along[:, None] * self.normals
        turned /= np.maximum(self._lengths, 1e-20)[:, None]
        result = self._at(turned, self._row, self._operator.shape[0]) @ self._operator
        if by_place is not None:
            result = result + self._at(by_place, self.points, 3 * len(self.vertices))
        return result

    @staticmethod
    def _at(
        values: Float[np.ndarray, "points 3"], place: Int[np.ndarray, " points"], width: int
    ) -> sp.csr_matrix:
        columns = 3 * place[:, None] + np.arange(3)
        pointer = np.arange(0, values.size + 1, 3)
        return sp.csr_matrix(
            (values.astype(np.float32).ravel(), columns.ravel(), pointer), (len(values), width)
        )


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
        self, sent: Float[np.ndarray, "3 patches"], patch: Int[np.ndarray, " hits"]
    ) -> tuple[sp.csr_matrix, ...]:
        """(points, 3 vertices) for each channel: what the points receive of patches that send so
        much, by the places of the vertices; each ray meets a ``patch``.
        """
        point, count = self.hits.point, len(self.turning.points)
        corners = self.turning.geometry.triangles[self.hits.triangle]
        moved = np.concatenate([self.turning.points[point, None], corners], axis=1)
        columns = (3 * moved[..., None] + np.arange(3)).astype(np.int32).ravel()
        rows = np.repeat(point, 12)
        by_place = self.by_place.reshape(-1, 12)
        shape = (count, 3 * len(self.turning.vertices))
        result = []
        for each in sent:
            ray = each[patch] / RAYS
            turned = np.stack(
                [np.bincount(point, ray * axis, count) for axis in self.by_normal.T], axis=1
            ).astype(float)  # whole numbers where no ray met skin
            values = (ray[:, None] * by_place).astype(np.float32).ravel()
            moving = sp.csr_matrix((values, (rows, columns)), shape)
            result.append(self.turning.changes(turned) + moving)
        return tuple(result)
