"""How cast shadows move: closed-form boundary terms of the photometric Jacobian.

The light that reaches a point p from a square light is an integral over the square of what it would
receive, times whether the way is free. Its derivative has, beside that of the integrand at fixed
visibility, a term on the edge of the visible part (Reynolds' transport theorem; Li et al. 2018
sample it): the integrand times the speed of the edge across the square. Scan lines along both sides
of the square meet that edge at places l = p + (q - p) / s, q on the occluder's silhouette and s its
share of the way. With n perpendicular to the silhouette and to the ray, moving q and p moves l
across the edge by

    n . dl = n . (dq - (1 - s) dp) / s.

Lines along x count an edge of normal (m_x, m_y) in the square with |m_x| per length, lines along y
with |m_y|; weighted m_x^2 and m_y^2 over their sum (Veach & Guibas 1995), no edge counts too much
or not at all. The lit point of a pixel moves only along the pixel's ray, to stay on its triangle.
Second-order effects, and edges nearer than CLOSEST to the point they shade (the terminator, whose
facets shadow themselves), are left out.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Bool, Float, Int
from facestage.contract.job import Job
from facestage.contract.light_stage import OFF, LightStage, fibonacci_stage
from facestage.fit.face.light_parameters import CHANNELS
from facestage.fit.face.state import State
from facestage.fit.forward.shading import ForwardModel, Image, Surface
from facestage.render.light_terms import Asked, LightTerms
from facestage.render.shadow_crossings import Cells, shadow_cells, shadow_crossings
from facestage.render.tracer import SHADOW_OFFSET

# Scan lines along each side of a light.
LINES = 1
# Samples where a light is partly hidden.
PENUMBRA_SAMPLES = 16
# Share of the light in penumbra below which the fit ends the same without (single hard lamps: at
# 0.5 % it ended 1 % nearer to the truth, at 1 % 6 % nearer, at 2 to 5 % 10 to 40 %).
PENUMBRA_MIN = 0.006
# A light nearer to its place on the unit lattice than this has not been moved.
LATTICE_TOLERANCE = 1e-3
# Metres from the lit point to its occluder.
CLOSEST = 2e-3
# A light that gives a pixel less than this share of what all its lights would has no edge worth a
# ray.
SHARE_MIN = 0.02
# Cosine between ray and surface, and between an edge's normal and the light's plane, below which a
# rate is noise.
COSINE_MIN = 0.05


@dataclass(frozen=True)
class ShadowEdges:
    """M places where the edge of a shadow crosses a scan line, sorted by the pixel they shade; P
    pixels.
    """

    pixel: Int[np.ndarray, " places"]
    corners: Int[np.ndarray, "places 2"]  # ends of the occluder's edge
    weights: Float[np.ndarray, "places 2"]  # where between them
    place: Float[np.ndarray, "places 3"]  # m, camera frame
    # length of scan line that the light gains per metre of motion of the place
    rate: Float[np.ndarray, "places 3"]
    color: Float[np.ndarray, "places 3"]  # radiance of the pixel per metre of scan line
    by_point: Float[np.ndarray, "pixels 3 3"]  # d color by the motion of the lit point in space
    # d color by the motion of the surface under the pixel
    by_surface: Float[np.ndarray, "pixels 3 3"]

    @cached_property
    def vertices(self) -> Int[np.ndarray, " vertices"]:
        """The vertices that cast the shadows, sorted."""
        return np.unique(self.corners)

    def part(self, part: slice) -> slice:
        """The places that shade the pixels of ``part``."""
        start, stop = np.searchsorted(self.pixel, [part.start, part.stop])
        return slice(int(start), int(stop))

    def pose(
        self, part: slice, translation: Float[np.ndarray, " 3"]
    ) -> Float[np.ndarray, "3 pixels 6"]:
        """The derivative by rotation about the model's origin and translation: what the occluder's
        motion changes.
        """
        where = self.part(part)
        rate, arm = self.rate[where], self.place[where] - translation
        return self._by_pixel(part, where, np.concatenate([np.cross(arm, rate), rate], axis=1))

    def shape(
        self,
        part: slice,
        rotation: Float[np.ndarray, "3 3"],
        basis: Float[np.ndarray, "coordinates modes"],
    ) -> Float[np.ndarray, "3 pixels modes"]:
        """The derivative by the weights of ``basis`` (3 v, modes) of ``vertices``: what occluders'
        motion changes.
        """
        where = self.part(part)
        count = where.stop - where.start
        data = (self.rate[where] @ rotation)[:, None] * self.weights[where][..., None]
        column = 3 * np.searchsorted(self.vertices, self.corners[where])[..., None] + np.arange(3)
        pointer = np.arange(0, 6 * count + 1, 6)
        moved = sp.csr_matrix(
            (data.astype(np.float32).ravel(), column.ravel(), pointer), (count, len(basis))
        )
        return self._by_pixel(part, where, moved @ basis)

    def _by_pixel(
        self, part: slice, where: slice, gain: Float[np.ndarray, "places columns"]
    ) -> Float[np.ndarray, "3 pixels columns"]:
        """Each place's color times what its edge gains (M of the part, columns),
        by pixel.
        """
        pixels, count = part.stop - part.start, where.stop - where.start
        row = (self.pixel[where] - part.start)[:, None] + pixels * np.arange(CHANNELS)
        column = np.broadcast_to(np.arange(count)[:, None], row.shape)
        data = self.color[where].astype(np.float32).ravel()
        collect = sp.csr_matrix((data, (row.ravel(), column.ravel())), (CHANNELS * pixels, count))
        return (collect @ gain).reshape(CHANNELS, pixels, gain.shape[1])


@dataclass(frozen=True)
class Penumbra:
    """The pixels from which a light is partly hidden, as scan lines on the light tell."""

    cells: Cells
    # pixels and lights, each pair once
    pairs: tuple[Int[np.ndarray, " pairs"], Int[np.ndarray, " pairs"]]
    share: float  # of the light on the pixels, unshadowed, that comes from partly hidden lights
    lines: int  # scan lines that were looked at


def find_penumbra(
    forward: ForwardModel,
    state: State,
    surface: Surface,
    stage: LightStage,
    weight: Float[np.ndarray, " pixels"],
    placed: Bool[np.ndarray, " lights"],
    seed: int,
    lines: int = LINES,
) -> Penumbra:
    """Where the shadows of ``stage`` (camera frame) have their edges, on pixels of positive
    ``weight``.

    ``placed``: the lights to look at. The mesh is the one traced last.
    """
    light = weight[:, None] * _unshadowed(surface, stage, forward.lights.radiance(state.lights))
    total = light.sum(axis=1, keepdims=True)
    pixel, lamp = np.nonzero((light > SHARE_MIN * np.maximum(total, 1e-30)) & placed)
    cells = shadow_cells(
        forward.tracer, forward.lit_points(state, surface, stage), (pixel, lamp), lines, seed
    )
    pairs = np.divmod(np.unique(cells.point * len(stage) + cells.light), len(stage))
    share = float(light[pairs].sum() / max(total.sum(), 1e-30))
    return Penumbra(cells, pairs, share, 2 * lines * len(pixel))


def refined(
    forward: ForwardModel,
    state: State,
    surface: Surface,
    stage: LightStage,
    terms: LightTerms,
    penumbra: Penumbra,
    *,
    samples: int,
    seed: int,
    asked: Asked,
) -> LightTerms:
    """``terms`` of ``samples`` per light with PENUMBRA_SAMPLES where a light is partly hidden.

    A few would make the edge of a shadow jump from pixel to pixel, by more than a good step of the
    fit gains.
    """
    if samples >= PENUMBRA_SAMPLES:
        return terms
    pixel, _ = penumbra.pairs
    few, many = (
        forward.light_terms(state, surface, stage, count, seed, asked, pairs=penumbra.pairs)
        for count in (samples, PENUMBRA_SAMPLES)
    )
    result: dict[str, Any] = {}
    for field in fields(LightTerms):
        values = getattr(terms, field.name)
        if field.name in ("diffuse", "specular"):
            result[field.name] = values.copy()
            result[field.name][penumbra.pairs] = getattr(many, field.name)[:, 0]
        elif isinstance(values, np.ndarray) and values.size and field.name != "indirect":
            # Sums over the lights: the same samples that are in them are taken out again.
            result[field.name] = values.copy()
            np.add.at(
                result[field.name], pixel, getattr(many, field.name) - getattr(few, field.name)
            )
    return replace(terms, **result)


def shadow_edges(
    forward: ForwardModel, state: State, image: Image, stage: LightStage, penumbra: Penumbra
) -> ShadowEdges:
    """The edges of the shadows on ``image``, lit by ``stage`` (camera frame), in its penumbra."""
    surface, cells = image.surface, penumbra.cells
    # The mesh that was traced last may have been a trial that was given up.
    forward.tracer.update(surface.vertices - state.translation)
    found = shadow_crossings(forward.tracer, forward.lit_points(state, surface, stage), cells)
    target = found.target + state.translation
    # Where the shadow rays start.
    point = surface.points[cells.point] + SHADOW_OFFSET * surface.facing[cells.point]
    ray = target - point
    corners, along, normal = _silhouette(
        forward.geometry.triangles[found.triangle], surface.vertices, point, ray
    )
    ends = surface.vertices[corners]
    place = ends[:, 0] + along[:, None] * (ends[:, 1] - ends[:, 0])
    share = np.einsum("mx,mx->m", place - point, ray) / np.einsum("mx,mx->m", ray, ray)
    # The edge's normal in the square, and the two lines' weights: rate = n / s * m_axis / (m_x^2 +
    # m_y^2).
    axes = np.stack([stage.axis_x[cells.light], stage.axis_y[cells.light]], axis=1)
    slope = np.einsum("max,mx->ma", axes, normal)
    steep = (slope**2).sum(axis=1)
    chosen = np.take_along_axis(slope, cells.axis[:, None], axis=1)[:, 0]
    far = np.linalg.norm(place - point, axis=1) > CLOSEST
    good = np.flatnonzero(
        far & (share > 0) & (share < 1) & (steep > COSINE_MIN**2) & (found.diffuse > 0)
    )
    pixel, light = cells.point[good], cells.light[good]
    scale = (
        np.where(cells.visible < cells.hidden, 1.0, -1.0)[good]
        * chosen[good]
        / (steep * share)[good]
    )
    rate = normal[good] * scale[:, None]

    skin = image.skin.part(pixel)
    color = image.radiance[light] * skin.radiance(
        found.diffuse[good, None], found.specular[good, None]
    )
    by_point = _by_point(
        pixel,
        -color[:, :, None] * ((1 - share[good])[:, None] * rate)[:, None],
        len(surface.points),
    )
    # At a fixed pixel the point moves along the pixel's ray: dp = ray (facing . dx) / (facing .
    # ray).
    incidence = np.einsum("px,px->p", surface.facing, surface.rays)
    slide = surface.facing / np.where(incidence < -COSINE_MIN, incidence, -np.inf)[:, None]
    by_surface = np.einsum("pcx,px->pc", by_point, surface.rays)[:, :, None] * slide[:, None]
    weights = np.stack([1 - along, along], axis=1)[good]
    return ShadowEdges(
        pixel, corners[good], weights, place[good], rate, color, by_point, by_surface
    )


def _by_point(
    pixel: Int[np.ndarray, " places"], each: Float[np.ndarray, "places 3 3"], count: int
) -> Float[np.ndarray, "pixels 3 3"]:
    """Sums of ``each`` over the places that shade a pixel."""
    collect = sp.csr_matrix(
        (np.ones(len(pixel)), (pixel, np.arange(len(pixel)))), (count, len(pixel))
    )
    return (collect @ each.reshape(len(pixel), 9)).reshape(count, CHANNELS, 3)


def _unshadowed(
    surface: Surface, stage: LightStage, radiance: Float[np.ndarray, "lights 3"]
) -> Float[np.ndarray, "pixels lights"]:
    """Irradiance by each light, taken at its middle and as if nothing were in the way."""
    offset = stage.position[None] - surface.points[:, None]
    square = np.einsum("pjx,pjx->pj", offset, offset)
    # A light whose middle has set may still show an edge.
    height = np.einsum("pjx,px->pj", offset, surface.normals) + 0.5 * stage.side
    cosine = -np.einsum("pjx,jx->pj", offset, stage.direction)
    return (
        stage.side**2
        * radiance.mean(axis=1)
        * np.maximum(height, 0)
        * np.maximum(cosine, 0)
        / square**2
    )


def casting_lights(
    stage: LightStage, radiance: Float[np.ndarray, "lights 3"]
) -> Bool[np.ndarray, " lights"]:
    """The lights that are bright enough for the edges of their shadows to be seen."""
    flux = stage.side**2 * radiance.mean(axis=1)
    return np.asarray(flux > SHARE_MIN * flux.sum())


def lamps_known(job: Job) -> bool:
    """Whether a shadow of the job's lights can tell shape: someone has put each where a lamp was.

    Lights that stand on the lattice stand for all light from about there. A shadow then says no
    more of the face than of the lamp's true place, and a fit that believes it bends the face.
    """
    if job.stage is None or job.camera_to_stage is None:
        return False
    # A fit may have put lights behind those of the lattice.
    position, lit = job.stage.position, job.stage.state != OFF
    front = position[:, 2] >= 0
    return not (_on_lattice(position)[lit].any() or _on_lattice(position[front])[lit[front]].any())


def _on_lattice(position: Float[np.ndarray, "lights 3"]) -> Bool[np.ndarray, " lights"]:
    """Which lights stand where the lattice of as many has them, at any distance."""
    if not len(position):
        return np.zeros(0, bool)
    outward = position / np.maximum(np.linalg.norm(position, axis=1, keepdims=True), 1e-9)
    away = np.abs(outward - fibonacci_stage(len(position)).position)
    return np.asarray(away.max(axis=1) < LATTICE_TOLERANCE)


def omission(share: float | None) -> tuple[str, str]:
    """What and why, of a fit that left edges out where it had found ``share`` in penumbra (None:
    did not look).
    """
    what = "motion of cast shadows in the derivatives"
    if share is None:
        return (
            what,
            "a shadow tells shape only of lamps whose places are known; these stand on a lattice",
        )
    if share < PENUMBRA_MIN:
        return what, f"{100 * share:.2f} % of the light on the face comes from partly hidden lights"
    return what, "of lights that stand on the lattice, or while hardly any was partly hidden"


def _silhouette(
    triangle: Int[np.ndarray, "places 3"],
    vertices: Float[np.ndarray, "vertices 3"],
    point: Float[np.ndarray, "places 3"],
    ray: Float[np.ndarray, "places 3"],
) -> tuple[
    Int[np.ndarray, "places 2"], Float[np.ndarray, " places"], Float[np.ndarray, "places 3"]
]:
    """The edge of the blocking ``triangle`` that the ray all but touches.

    Its two corners, how far along it, and the unit normal of the plane of edge
    and ray.
    """
    starts, ends = vertices[triangle], vertices[np.roll(triangle, -1, axis=1)]
    edge = ends - starts
    normal = np.cross(edge, ray[:, None])
    normal /= np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-20)
    distance = np.abs(np.einsum("mex,mex->me", normal, point[:, None] - starts))
    nearest = distance.argmin(axis=1)
    row = np.arange(len(nearest))
    edge, start, normal = edge[row, nearest], starts[row, nearest], normal[row, nearest]
    # Where along the edge, seen along the ray.
    unit = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    flat = edge - unit * np.einsum("mx,mx->m", edge, unit)[:, None]
    along = np.einsum("mx,mx->m", flat, point - start) / np.maximum(
        np.einsum("mx,mx->m", flat, flat), 1e-20
    )
    corners = np.stack(
        [triangle[row, nearest], np.roll(triangle, -1, axis=1)[row, nearest]], axis=1
    )
    return corners, np.clip(along, 0, 1), normal
