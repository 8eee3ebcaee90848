"""How cast shadows move: closed-form boundary terms of the photometric Jacobian.

The light that reaches a point p from a square light is an integral over the square of what it would receive,
times whether the way is free. Its derivative has, beside that of the integrand at fixed visibility, a term on
the edge of the visible part (Reynolds' transport theorem; Li et al. 2018, section 3, for images): the
integrand times the speed of the edge across the square. Scan lines along both sides of the square meet that edge
at places l = p + (q - p) / s, q on the occluder's silhouette and s its share of the way. With n perpendicular
to the silhouette and to the ray, moving q and p moves l across the edge by

    n . dl = n . (dq - (1 - s) dp) / s.

Lines along x count an edge of normal (m_x, m_y) in the square with |m_x| per length, lines along y with |m_y|;
weighted m_x^2 and m_y^2 over their sum (Veach & Guibas 1995), no edge counts too much or not at all. The lit
point of a pixel moves only along the pixel's ray, to stay on its triangle. Second-order effects, and edges nearer
than CLOSEST to the point they shade (the terminator, whose facets shadow themselves), are left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from facestage.contract import brdf
from facestage.contract.light_stage import LightStage
from facestage.fit.parameters import CHANNELS, State
from facestage.fit.shading import ForwardModel, Image, Surface
from facestage.render.shadow_edges import Crossings
from facestage.render.tracer import SHADOW_OFFSET

# The blocks of parameters that move the mesh, or the view of it.
MOVES_SHADOWS = ("pose", "focal", "identity", "expression")
# Scan lines along each side of a light.
LINES = 1
# Metres from the lit point to its occluder.
CLOSEST = 2e-3
# A light that gives a pixel less than this share of what all its lights would has no edge worth a ray.
SHARE_MIN = 0.02
# Cosine between ray and surface, and between an edge's normal and the light's plane, below which a rate is noise.
COSINE_MIN = 0.05


@dataclass(frozen=True)
class ShadowEdges:
    """M places where the edge of a shadow crosses a scan line, sorted by the pixel they shade; P pixels."""

    pixel: np.ndarray  # (M,) int
    corners: np.ndarray  # (M, 2) int, ends of the occluder's edge
    weights: np.ndarray  # (M, 2) where between them
    place: np.ndarray  # (M, 3) m, camera frame
    rate: np.ndarray  # (M, 3) length of scan line that the light gains per metre of motion of the place
    color: np.ndarray  # (M, 3) radiance of the pixel per metre of scan line
    by_point: np.ndarray  # (P, 3, 3) d color by the motion of the lit point in space
    by_surface: np.ndarray  # (P, 3, 3) d color by the motion of the surface under the pixel
    penumbra: float  # share of the light on the pixels, unshadowed, that comes from partly hidden lights

    def part(self, part: slice) -> slice:
        """The places that shade the pixels of ``part``."""
        start, stop = np.searchsorted(self.pixel, [part.start, part.stop])
        return slice(int(start), int(stop))

    def pose(self, part: slice, translation: np.ndarray) -> np.ndarray:
        """(3 B, 6) by rotation about the model's origin and translation: what the occluder's motion changes."""
        where = self.part(part)
        rate, arm = self.rate[where], self.place[where] - translation
        return self._by_pixel(part, where) @ np.concatenate([np.cross(arm, rate), rate], axis=1)

    def shape(self, part: slice, rotation: np.ndarray, basis: np.ndarray) -> np.ndarray:
        """(3 B, k + e) by the weights of ``basis`` (3 m, k + e): what the occluder's motion changes."""
        where = self.part(part)
        count = where.stop - where.start
        data = (self.rate[where] @ rotation)[:, None] * self.weights[where][..., None]
        column = 3 * self.corners[where][..., None] + np.arange(3)
        pointer = np.arange(0, 6 * count + 1, 6)
        moved = sp.csr_matrix((data.astype(np.float32).ravel(), column.ravel(), pointer), (count, len(basis)))
        return self._by_pixel(part, where) @ (moved @ basis)

    def _by_pixel(self, part: slice, where: slice) -> sp.csr_matrix:
        """(3 B, M of the part): each place's color, in the rows of its pixel."""
        count = where.stop - where.start
        row = CHANNELS * (self.pixel[where] - part.start)[:, None] + np.arange(CHANNELS)
        column = np.broadcast_to(np.arange(count)[:, None], row.shape)
        data = self.color[where].astype(np.float32).ravel()
        return sp.csr_matrix((data, (row.ravel(), column.ravel())), ((part.stop - part.start) * CHANNELS, count))


def shadow_edges(
    forward: ForwardModel, state: State, image: Image, stage: LightStage, seed: int, wanted: np.ndarray,
    lines: int = LINES,
) -> ShadowEdges:  # fmt: skip
    """The edges of the shadows on the ``wanted`` (P,) bool pixels of ``image``, lit by ``stage`` (camera frame)."""
    surface = image.surface
    light = _unshadowed(surface, stage, image.radiance) * wanted[:, None]
    pairs = np.nonzero(light > SHARE_MIN * np.maximum(light.sum(axis=1, keepdims=True), 1e-30))
    found = forward.shadow_crossings(state, surface, stage, pairs, lines, seed)
    partly = np.zeros(light.shape, bool)
    partly[found.point, found.light] = True
    penumbra = float(light[partly].sum() / max(light.sum(), 1e-30))
    return _edges(found, forward, image, stage, penumbra)


def _unshadowed(surface: Surface, stage: LightStage, radiance: np.ndarray) -> np.ndarray:
    """(P, N) irradiance by each light, taken at its middle and as if nothing were in the way."""
    offset = stage.position[None] - surface.points[:, None]
    square = np.einsum("pjx,pjx->pj", offset, offset)
    distance = np.sqrt(square)
    # A light whose middle has set may still show an edge.
    height = np.einsum("pjx,px->pj", offset, surface.normals) + 0.5 * stage.side
    cosine = -np.einsum("pjx,jx->pj", offset, stage.direction)
    brightness = stage.side**2 * radiance.mean(axis=1)
    return brightness * np.maximum(height, 0) * np.maximum(cosine, 0) / (square * distance * distance)


def _edges(found: Crossings, forward: ForwardModel, image: Image, stage: LightStage, penumbra: float) -> ShadowEdges:
    surface = image.surface
    # Where the shadow rays start.
    point = surface.points[found.point] + SHADOW_OFFSET * surface.facing[found.point]
    ray = found.target - point
    corners, along, normal = _silhouette(found, forward, surface.vertices, point, ray)
    ends = surface.vertices[corners]
    place = ends[:, 0] + along[:, None] * (ends[:, 1] - ends[:, 0])
    share = np.einsum("mx,mx->m", place - point, ray) / np.einsum("mx,mx->m", ray, ray)
    # The edge's normal in the square, and the two lines' weights: rate = n / s * m_axis / (m_x^2 + m_y^2).
    axes = np.stack([stage.axis_x[found.light], stage.axis_y[found.light]], axis=1)
    slope = np.einsum("max,mx->ma", axes, normal)
    steep = (slope**2).sum(axis=1)
    chosen = np.take_along_axis(slope, found.axis[:, None], axis=1)[:, 0]
    far = np.linalg.norm(place - point, axis=1) > CLOSEST
    good = far & (share < 1) & (steep > COSINE_MIN**2)
    scale = np.where(found.visible_before, 1.0, -1.0) * chosen / np.where(good, steep * share, np.inf)
    rate = normal * scale[:, None]

    radiance = image.radiance[found.light]
    albedo = image.albedo[found.point] * (brdf.K_DIFFUSE / np.pi)
    gloss = brdf.K_SPECULAR * image.c_spec[found.point, None]
    color = radiance * (albedo * found.diffuse[:, None] + gloss * found.specular[:, None])

    moved = -color[:, :, None] * ((1 - share)[:, None] * rate)[:, None, :]
    count = len(found.point)
    collect = sp.csr_matrix((np.ones(count), (found.point, np.arange(count))), (len(surface.points), count))
    by_point = (collect @ moved.reshape(count, -1)).reshape(-1, CHANNELS, 3)
    # At a fixed pixel the point moves along the pixel's ray: dp = ray (facing . dx) / (facing . ray).
    incidence = np.einsum("px,px->p", surface.facing, surface.rays)
    slide = surface.facing / np.where(incidence < -COSINE_MIN, incidence, -np.inf)[:, None]
    by_surface = np.einsum("pcx,px->pc", by_point, surface.rays)[:, :, None] * slide[:, None]
    order = np.argsort(found.point, kind="stable")
    order = order[good[order]]
    weights = np.stack([1 - along, along], axis=1)
    return ShadowEdges(
        found.point[order], corners[order], weights[order], place[order], rate[order], color[order],
        by_point, by_surface, penumbra,
    )  # fmt: skip


def _silhouette(
    found: Crossings, forward: ForwardModel, vertices: np.ndarray, point: np.ndarray, ray: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The edge of the blocking triangle that the ray all but touches.

    Its two corners (M, 2), how far along it (M,), and the unit normal (M, 3) of the plane of edge and ray.
    """
    triangle = forward.geometry.triangles[found.triangle]
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
    along = np.einsum("mx,mx->m", flat, point - start) / np.maximum(np.einsum("mx,mx->m", flat, flat), 1e-20)
    corners = np.stack([triangle[row, nearest], np.roll(triangle, -1, axis=1)[row, nearest]], axis=1)
    return corners, np.clip(along, 0, 1), normal
