"""Light that skin sends to skin: between chin and neck, nose and cheek, in the sockets of the eyes.

Radiosity (Goral et al. 1984) on a few hundred patches of the mesh. Skin that receives irradiance E
sends back B = a E, of each color channel the share a that a white sky would have; a point receives
the mean of B over directions that are spread as the cosine to its normal, the direct light D beside
it: E = D + F B, so B = a (1 - F a)^-1 D. As the direct light, this is linear in the lights, so each
has a picture of its own that lights and relights. Highlights of highlights are not followed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.spatial import cKDTree

from facestage.contract import brdf
from facestage.contract.arrays import Bool, Float, Float32, Int
from facestage.contract.light_stage import LightStage
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.light_parameters import CHANNELS
from facestage.fit.forward.reflectance import UNIFORM, albedo_of
from facestage.render.light_terms import Asked, LitPoints
from facestage.render.tracer import RayTracer

# About how many points gather light, how many patches (the first of the points) send it back, and
# rays of each point. With twice as many and more, what is wrong beside Cycles is less by
# a tenth (docs/transport.md).
POINTS, PATCHES, RAYS = 2000, 240, 24
LIGHT_SAMPLES = 2  # per point and light
GRID_ROUNDS = 12  # of halving the cell that gives so many points
NEIGHBOURS = 4  # points that a vertex takes its light from
# Metres that two opposite normals count as apart: lips and lids touch, and face different ways; and
# points are dense where the surface bends, which is where it sees itself.
NORMAL_REACH = 0.03
# Metres between parts that touch: an eye's light is none of the lid's. And how much sparser points
# are where no pixel is compared.
PART_REACH, SPARSER = 1.0, 3.0
RAY_OFFSET = 2e-4  # metres off the surface, as shadow rays begin
ROUNDS = 8  # of light from patch to patch: what is left then is a share of 0.9^9 F^9


@dataclass(frozen=True)
class SkinHits:
    """The rays of the points that meet the mesh: where, and of which point each is."""

    point: Int[np.ndarray, " hits"]
    triangle: Int[np.ndarray, " hits"]
    barycentric: Float[np.ndarray, "hits 3"]


class Bounces:
    """The patches of one face; what hangs on its mean shape alone is found once."""

    def __init__(self, geometry: FaceGeometry, resting: bool = False) -> None:
        """``resting``: patches see of each other what they do on the mean shape, whatever shape
        light falls on.
        """
        self.geometry, self.resting = geometry, resting
        self._factors_at_rest: sp.csr_matrix | None = None
        self._last_seen: tuple[np.ndarray, SkinHits] | None = None

    @cached_property
    def points(self) -> Int[np.ndarray, " points"]:
        """All vertices, or about POINTS, one for each cell of a grid over place and normal; the
        first are the middles of the patches, far from each other.
        """
        candidates = np.unique(self.geometry.triangles)
        dense = np.isin(candidates, self.geometry.fitted_vertices)
        places = self._places[candidates] / np.where(dense, 1.0, SPARSER)[:, None]
        first = np.arange(len(candidates))
        high = float(np.ptp(places[:, :3], axis=0).max())
        low = high / 1000
        for _ in range(GRID_ROUNDS if len(candidates) > POINTS else 0):
            cell = 0.5 * (low + high)
            cells = np.round(places / cell).astype(np.int64)
            cells -= cells.min(axis=0)
            numbers = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
            first = np.unique(numbers, return_index=True)[1]
            low, high = (cell, high) if len(first) > POINTS else (low, cell)
        return candidates[first[_far_apart(places[first], PATCHES)]]

    @cached_property
    def _places(self) -> Float[np.ndarray, "vertices 7"]:
        """Where the mean face's vertices are, where they look, and what part they are of."""
        mean, part = self.geometry.mean, np.zeros(len(self.geometry.mean))
        part[self.geometry.triangles] = self.geometry.triangle_part[:, None]
        normals = self.geometry.vertex_normals(mean)[0]
        return np.concatenate([mean, NORMAL_REACH / 2 * normals, PART_REACH * part[:, None]], 1)

    @cached_property
    def _around(self) -> Int[np.ndarray, " triangles"]:
        """The triangles that the points' normals hang on."""
        at = np.zeros(len(self.geometry.mean), bool)
        at[self.points] = True
        return np.flatnonzero(at[self.geometry.triangles].any(axis=1))

    @cached_property
    def _patch_of_point(self) -> Int[np.ndarray, " points"]:
        return self._nearest_patch(self._places[self.points])

    @cached_property
    def patch_of_triangle(self) -> Int[np.ndarray, " triangles"]:
        """Which patch each triangle belongs to."""
        return self._nearest_patch(self._places[self.geometry.triangles].mean(axis=1))

    def _nearest_patch(self, places: Float[np.ndarray, "places 7"]) -> Int[np.ndarray, " places"]:
        return cKDTree(self._places[self.points[:PATCHES]]).query(places)[1]

    @cached_property
    def members(self) -> sp.csr_matrix:
        """(patches, points) the mean over the points of each patch."""
        patch = self._patch_of_point
        share = 1.0 / np.bincount(patch, minlength=int(patch.max()) + 1)[patch]
        return sp.csr_matrix((share, (patch, np.arange(len(patch)))))

    @cached_property
    def spread(self) -> sp.csr_matrix:
        """(vertices, points) what each vertex takes of the points around it."""
        count = min(NEIGHBOURS, len(self.points))
        distance, index = cKDTree(self._places[self.points]).query(self._places, k=count)
        distance, index = distance.reshape(-1, count), index.reshape(-1, count)
        weight = 1.0 / (distance**2 + (0.25 * distance[:, -1:]) ** 2 + 1e-12)
        weight /= weight.sum(axis=1, keepdims=True)
        pointer = np.arange(0, weight.size + 1, count)
        shape = (len(self._places), len(self.points))
        return sp.csr_matrix((weight.astype(np.float32).ravel(), index.ravel(), pointer), shape)

    def irradiance(
        self,
        tracer: RayTracer,
        vertices: Float[np.ndarray, "vertices 3"],
        log_albedo: Float[np.ndarray, "vertices 3"],
        stage: LightStage,
        numbers: Int[np.ndarray, " lights"],
        c_spec: float,
        seed: int,
        traced: Bool[np.ndarray, " lights"] | None = None,
    ) -> Float32[np.ndarray, "3 points lights"]:
        """What the points receive from other skin under each light of radiance 1, by channel.

        Its skin is of ``log_albedo`` and all of one ``c_spec``.

        ``tracer`` holds the mesh at ``vertices``, in whose frame ``stage`` is; lights that are not
        ``traced`` send nothing.
        """
        lit = self.lit_points(vertices, stage, numbers)
        direct = tracer.light_terms(
            lit, LIGHT_SAMPLES, seed, Asked(specular=False), traced=traced
        ).diffuse
        if self.resting:
            factors = self._at_rest(tracer, vertices)
        else:
            factors = self.form_factors(self.seen(tracer, vertices, lit))
        between = self.members @ factors
        share = self.share(log_albedo, c_spec)
        result = np.empty((CHANNELS, *direct.shape), np.float32)
        first = self.members @ direct
        for channel in range(CHANNELS):
            result[channel] = factors @ sent_on(between, share[:, channel], first)
        return result

    def lit_points(
        self,
        vertices: Float[np.ndarray, "vertices 3"],
        stage: LightStage,
        numbers: Int[np.ndarray, " lights"],
    ) -> LitPoints:
        """The points as the tracer takes them."""
        normals = self.geometry.vertex_normals(vertices, self._around)[0][self.points]
        places = vertices[self.points]
        return LitPoints(places, normals, normals, normals, stage, 0.5, self.points, numbers)

    def share(
        self, log_albedo: Float[np.ndarray, "vertices 3"], c_spec: float
    ) -> Float[np.ndarray, "patches 3"]:
        """Of the light that patches receive, what they send back."""
        albedo = albedo_of(self.members @ log_albedo[self.points])
        return brdf.matte(np.pi, albedo) + UNIFORM * c_spec

    def _at_rest(
        self, tracer: RayTracer, vertices: Float[np.ndarray, "vertices 3"]
    ) -> sp.csr_matrix:
        """The form factors of the mean shape; ``tracer`` holds the mesh at ``vertices``."""
        if self._factors_at_rest is None:
            mean = self.geometry.mean
            normals = self.geometry.vertex_normals(mean, self._around)[0][self.points]
            tracer.update(mean)
            hits = self.hits(tracer, mean[self.points], normals)
            self._factors_at_rest = self.form_factors(hits)
            tracer.update(vertices)
        return self._factors_at_rest

    def seen(
        self, tracer: RayTracer, vertices: Float[np.ndarray, "vertices 3"], lit: LitPoints
    ) -> SkinHits:
        """What the points see of the mesh at ``vertices``, which ``tracer`` holds; of the mesh that
        was asked for last it is known.
        """
        if self._last_seen is None or not np.array_equal(self._last_seen[0], vertices):
            self._last_seen = vertices, self.hits(tracer, lit.points, lit.normals)
        return self._last_seen[1]

    def hits(
        self,
        tracer: RayTracer,
        places: Float[np.ndarray, "points 3"],
        normals: Float[np.ndarray, "points 3"],
    ) -> SkinHits:
        """What the points see of the mesh, by RAYS rays each, spread as the cosine."""
        local = _cosine_directions(RAYS)
        helper = np.where(np.abs(normals[:, :1]) < 0.7, [[1.0, 0, 0]], [[0, 1.0, 0]])
        x = np.cross(helper, normals)
        x /= np.linalg.norm(x, axis=1, keepdims=True)
        frame = np.stack([x, np.cross(normals, x), normals], axis=1)  # rows
        directions = (local @ frame).reshape(-1, 3)
        origins = np.repeat(places + RAY_OFFSET * normals, RAYS, axis=0)
        found = tracer.first_hits(origins, directions)
        met = found.triangle >= 0
        point = np.repeat(np.arange(len(places)), RAYS)[met]
        return SkinHits(point, found.triangle[met], found.barycentric[met].astype(np.float64))

    def form_factors(self, hits: SkinHits) -> sp.csr_matrix:
        """(points, patches): the share of a point's cosine-weighted view that each patch fills."""
        column = self.patch_of_triangle[hits.triangle]
        shape = (len(self.points), self.members.shape[0])
        share = np.full(len(column), 1.0 / RAYS, np.float32)
        return sp.csr_matrix((share, (hits.point, column)), shape)

    def at_pixels(
        self,
        received: Float32[np.ndarray, "3 points lights"],
        corners: Int[np.ndarray, "pixels 3"],
        weights: Float[np.ndarray, "pixels 3"],
    ) -> Float32[np.ndarray, "3 pixels lights"]:
        """What pixels that see these ``corners``, mixed by ``weights``, receive."""
        pick = between_corners(corners, weights, self.spread.shape[0])
        channels, points, lights = received.shape
        flat = received.transpose(1, 0, 2).reshape(points, channels * lights)
        # From the right: sparse times dense, twice.
        result = (pick @ (self.spread @ flat)).reshape(-1, channels, lights)
        return np.ascontiguousarray(result.transpose(1, 0, 2))


def between_corners(
    corners: Int[np.ndarray, "pixels 3"], weights: Float[np.ndarray, "pixels 3"], vertices: int
) -> sp.csr_matrix:
    """(pixels, vertices): what pixels that see these ``corners``, mixed by ``weights``, take of
    them.
    """
    pointer = np.arange(0, corners.size + 1, 3)
    entries = (weights.astype(np.float32).ravel(), corners.ravel(), pointer)
    return sp.csr_matrix(entries, shape=(len(corners), vertices))


def sent_on(
    between: sp.csr_matrix,
    share: Float[np.ndarray, " patches"],
    first: Float[np.ndarray, "patches ..."],
) -> Float[np.ndarray, "patches ..."]:
    """All that patches send if they receive ``first`` from elsewhere."""
    sent = share[:, None] * first
    total = sent
    for _ in range(ROUNDS):
        sent = share[:, None] * (between @ sent)
        total = total + sent
    return total


def _cosine_directions(count: int) -> Float[np.ndarray, "_ 3"]:
    """Unit directions around +Z, spread evenly as the cosine to it (a spiral on the disc)."""
    index = np.arange(count) + 0.5
    radius, angle = np.sqrt(index / count), index * np.pi * (3.0 - np.sqrt(5.0))
    height = np.sqrt(1.0 - radius**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def _far_apart(places: Float[np.ndarray, "places _"], count: int) -> Int[np.ndarray, " places"]:
    """The order of all places in which each of the first ``count`` is the farthest from those
    before it.
    """
    chosen = np.zeros(min(count, len(places)), np.int64)
    distance = np.full(len(places), np.inf)
    for index in range(1, len(chosen)):
        nearer = ((places - places[chosen[index - 1]]) ** 2).sum(axis=1)
        distance = np.minimum(distance, nearer)
        chosen[index] = int(distance.argmax())
    return np.concatenate([chosen, np.setdiff1d(np.arange(len(places)), chosen)])
