"""The photometric term: derivatives of the rendered radiance by every parameter, streamed in
blocks.

The visibility of lights is held fixed unless the edges of shadows are given (shadow_edges.py);
everything else is exact but for the focal length, whose column leaves out that the lit point also
shifts sideways and is seen from elsewhere (a tenth of it, with lights a metre away; the landmarks
carry most of what is known of the lens). At a fixed pixel, moving the surface by dx changes where
its ray lands: (db1, db2, dt) = -M^-1 dx with M = [e1, e2, -ray], which moves albedo, normal and
specular value across the triangle and the point along the ray.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Bool, Float, Float32, Int
from facestage.contract.face_model import SKIN
from facestage.contract.scattering import BULGE_M, SLANT
from facestage.fit.energy.received_light import ReceivedLight
from facestage.fit.energy.shadow_edges import ShadowEdges
from facestage.fit.face.layout import Layout
from facestage.fit.face.light_parameters import CHANNELS
from facestage.fit.face.state import State
from facestage.fit.face.unknowns import SURFACE
from facestage.fit.forward.bounces import between_corners
from facestage.fit.forward.lamp_derivatives import AXES, PositionDerivatives
from facestage.fit.forward.moving_bounces import MovingBounces
from facestage.fit.forward.reflectance import by_c_spec, uniform_lobe
from facestage.fit.forward.scattering import Scattering
from facestage.fit.forward.shading import ForwardModel, Image, bilinear_weights

BLOCK_PIXELS = 8192


@dataclass(frozen=True)
class JacobianBlock:
    """Rows of the Jacobian for B pixels, kept in the factors that it is made of.

    d color / d radiance is one (B, n) matrix per channel, because light of one color lights that
    color only; d color / d specular texels is ``gloss`` times ``texels``.
    """

    pixels: slice
    dense: Float32[np.ndarray, "3 pixels columns"]  # the columns of _Differential.dense_columns
    # d color by the radiance of the lights of _Differential.light_index
    lights: Float32[np.ndarray, "3 pixels lights"]
    gloss: Float[np.ndarray, "pixels 3"]  # specular radiance at c_spec = 1
    texels: sp.csr_matrix | None  # bilinear weights; None when the map is not asked for


class Jacobian:
    """d color / d parameters of one evaluation, in blocks of pixels.

    ``active`` marks the wanted parameters. What is zero for every pixel has no column:
    a mode that moves nothing seen (unless ``all_columns``), a light that reaches nothing.
    """

    def __init__(
        self,
        forward: ForwardModel,
        state: State,
        image: Image,
        layout: Layout,
        active: Bool[np.ndarray, " unknowns"],
        all_columns: bool = False,
        positions: PositionDerivatives | None = None,
        edges: ShadowEdges | None = None,
        *,
        bounces: MovingBounces | None = None,
    ) -> None:
        """``positions``: needed where ``active`` asks for places of lights.

        ``edges``: shadows move with the shape; ``bounces``: light from skin to skin does, and
        changes with the albedo.
        """
        self.positions, self.edges = positions, edges
        self.forward, self.state, self.image, self.layout = forward, state, image, layout
        self.active = {name: bool(active[where].any()) for name, where in layout.slices.items()}
        self.geometry = forward.geometry
        chosen = active.copy()
        shape = layout.shape
        self._deforms = bool(active[shape].any())
        of_albedo = active[layout.slices["albedo"]]
        self._albedo_modes = self.geometry.albedo_columns[:, :, of_albedo]
        self._received = None
        if bounces is not None:
            self._received = ReceivedLight(bounces, image, self._albedo_modes)
        self._bulges = None if image.excess is None else forward.bulges(image.surface)
        if self._deforms:
            self._prepare_shape(chosen, shape, all_columns)
        if self._moves:
            self._logs = forward.log_albedo(state)
        for name in ("lights", "specular"):
            chosen[layout.slices[name]] = False
        if positions is None:
            chosen[layout.slices["light_position"]] = False
        self.dense_columns = np.flatnonzero(chosen)  # entries of the parameter vector
        # wanted, but zero for every pixel
        self.unseen = int(active[shape].sum() - chosen[shape].sum())
        reach = np.ones(len(image.radiance), bool)
        if not all_columns:
            reach = image.terms.diffuse.any(axis=0) | image.terms.specular.any(axis=0)
        # Among the fitted lights; their radiance by the light parameters.
        index = (
            np.flatnonzero(forward.lights.fitted & reach)
            if self.active["lights"]
            else np.zeros(0, int)
        )
        self.light_index = index
        self.unseen += (int(forward.lights.fitted.sum()) - len(index)) * self.active["lights"]
        place = np.cumsum(forward.lights.fitted) - 1
        # (n, 3, light parameters)
        self.light_jacobian = forward.lights.jacobian(state.lights)[place[index]]

    def _prepare_shape(
        self, chosen: Bool[np.ndarray, " unknowns"], shape: slice, all_columns: bool
    ) -> None:
        """The modes' motion of the seen vertices and of their normals, and which modes have any."""
        surface, geometry = self.image.surface, self.geometry
        seen = np.zeros(len(geometry.mean), bool)
        seen[surface.corners] = True
        around = np.zeros(len(geometry.mean), bool)
        around[geometry.triangles[seen[geometry.triangles].any(axis=1)]] = True
        if not all_columns:
            moving = geometry.influence[around].any(axis=0)
            if self.edges is not None:
                moving |= geometry.influence[self.edges.vertices].any(axis=0)
            chosen[shape] &= moving[: shape.stop - shape.start]
        modes = np.flatnonzero(chosen[shape])
        basis = geometry.modes(modes)
        turning = seen if self._bulges is None else geometry.bends.around(seen)
        self._local, self._turning_count = np.cumsum(turning) - 1, int(turning.sum())
        self._place, self._seen_count = np.cumsum(seen) - 1, int(seen.sum())
        # Rows by x, y, z of the turning vertices, the same of their normals, and of the seen
        # vertices their curvature and what they receive of other skin, in three channels.
        ends = np.cumsum(
            [
                3 * self._turning_count,
                3 * self._turning_count,
                self._seen_count * (self._bulges is not None),
                CHANNELS * self._seen_count * (self._received is not None),
            ]
        )
        self._shape_basis = np.empty((ends[-1], len(modes)), np.float32)
        moved, turned, bent, received = np.split(self._shape_basis, ends[:-1])
        coordinates = 3 * np.flatnonzero(turning)[:, None] + np.arange(3)
        np.take(basis, coordinates.ravel(), axis=0, out=moved, mode="clip")
        turned[:] = geometry.normal_operator(surface.model_vertices, turning) @ basis
        if self._bulges is not None:
            normals, lengths = surface.model_normals, surface.normal_scale
            bent[:] = geometry.bends.change(
                surface.model_vertices, normals, lengths, seen, moved, turned
            )
        if self._received is not None:
            by_shape = self._received.bounces.by_shape(basis, np.flatnonzero(seen))
            received[:] = by_shape.reshape(-1, len(modes))
        if self.edges is not None:
            # (3 vertices that cast shadows, modes)
            self._edge_basis = basis.reshape(len(geometry.mean), -1)[self.edges.vertices].reshape(
                -1, len(modes)
            )

    def blocks(self, size: int = BLOCK_PIXELS) -> Iterator[JacobianBlock]:
        """All pixels, ``size`` at a time."""
        for start in range(0, len(self.image.color), size):
            yield self.block(start, min(start + size, len(self.image.color)))

    def block(self, start: int, end: int) -> JacobianBlock:
        """The rows of the pixels from ``start`` to ``end``."""
        image, active = self.image, self.active
        part = slice(start, end)
        parts: list[np.ndarray] = []
        if self._moves:
            by_normal, slide = self._surface_derivatives(part)
            if self.edges is not None:
                slide += self.edges.by_surface[part]
            if active["pose"]:
                parts.append(self._pose(part, by_normal, slide)[..., self._wanted("pose")])
            if active["focal"]:
                parts.append(self._focal(part, slide))
            if self._deforms:
                parts.append(self._shape(part, by_normal, slide))
        if active["light_position"] and self.positions is not None:
            parts.append(self._light_positions(part, self.positions))
        if active["albedo"]:
            parts.append(self._albedo(part))
        if active["roughness"]:
            by_roughness = image.skin.part(part).gloss(image.terms.specular_by_roughness[part])
            parts.append(by_roughness.T[..., None])
        if active["interreflection"]:
            parts.append(self._interreflection(part))
        if active["scattering"]:
            parts.append(self._scattering(part))
        if active["translucency"]:
            parts.append(self._translucency(part))
        dense = np.zeros((CHANNELS, end - start, len(self.dense_columns)), np.float32)
        if parts:
            np.concatenate(parts, axis=2, out=dense, casting="same_kind")
        texels = self._texels(part) if active["specular"] else None
        return JacobianBlock(
            part, dense, self._lights(part), by_c_spec(image.specular[part]), texels
        )

    @property
    def _moves(self) -> bool:
        """Whether points or normals do."""
        return any(self.active[name] for name in SURFACE)

    def _wanted(self, name: str) -> Int[np.ndarray, " columns"]:
        where = self.layout.slices[name]
        inside = (self.dense_columns >= where.start) & (self.dense_columns < where.stop)
        return self.dense_columns[inside] - where.start

    def _surface_derivatives(
        self, part: slice
    ) -> tuple[Float[np.ndarray, "pixels 3 3"], Float[np.ndarray, "pixels 3 3"]]:
        """d color by the interpolated normal and by surface motion.

        The motion term already contains what sliding across the triangle changes.
        """
        image, surface, terms = self.image, self.image.surface, self.image.terms
        skin = image.skin.part(part)
        by_depth = skin.radiance(terms.diffuse_by_depth[part], terms.specular_by_depth[part])
        by_unit = skin.radiance(terms.diffuse_by_normal[part], terms.specular_by_normal[part])
        if image.excess is not None:
            by_slant = SLANT * self._by_excess(part)
            by_unit = by_unit + by_slant[..., None] * surface.rays[part][:, None]
        # Through the normalisation of the interpolated normal: tangential part only, over its
        # length.
        normal, length = surface.normals[part], surface.normal_length[part]
        along = np.einsum("pcx,px->pc", by_unit, normal)
        by_normal = (by_unit - along[..., None] * normal[:, None]) / length[:, None, None]

        corners = surface.vertices[surface.corners[part]]
        edges = np.stack(
            [corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], -surface.rays[part]],
            axis=-1,
        )
        inverse = _inverse3(edges)  # rows: db1, db2, dt per -dx
        by_edge = []
        corner_normals = surface.corner_normals[part]
        logs = self._logs[surface.corners[part]]
        by_log_albedo = skin.by_log_albedo(image.diffuse[part])
        uvs = self.geometry.model.uvs[self.geometry.triangle_uvs[surface.triangle[part]]]
        gradient = _texture_gradient(self.state.specular, self.forward.uvs(surface.part(part)))
        for edge in (1, 2):
            change = by_log_albedo * (logs[:, edge] - logs[:, 0])
            change += np.einsum(
                "pcx,px->pc", by_normal, corner_normals[:, edge] - corner_normals[:, 0]
            )
            spec_change = np.einsum("px,px->p", gradient, uvs[:, edge] - uvs[:, 0])
            change += by_c_spec(image.specular[part]) * spec_change[:, None]
            if self._bulges is not None:
                bend = self._bulges[surface.corners[part]]
                change += self._by_bulge(part) * (bend[:, edge] - bend[:, 0])[:, None]
            if self._received is not None:
                change += self._received.along_edge(part, edge)
            by_edge.append(change)
        rates = np.stack([*by_edge, by_depth], axis=-1)  # (B, channel, 3)
        return by_normal, -np.einsum("pci,pix->pcx", rates, inverse)

    def _by_excess(self, part: slice) -> Float[np.ndarray, "pixels 3"]:
        """By how unevenly light comes out at strength 1."""
        image = self.image
        skin = self.geometry.triangle_part[image.surface.triangle[part]] == SKIN
        by_excess = image.skin.part(part).by_excess(image.diffuse[part])
        return self.state.translucency * skin[:, None] * by_excess

    def _by_bulge(self, part: slice) -> Float[np.ndarray, "pixels 3"]:
        """By mean curvature."""
        return np.array(BULGE_M) * self._by_excess(part)

    def _pose(
        self,
        part: slice,
        by_normal: Float[np.ndarray, "pixels 3 3"],
        slide: Float[np.ndarray, "pixels 3 3"],
    ) -> Float[np.ndarray, "3 pixels 6"]:
        """By rotation about the model's origin, then translation. a.(w x b) = w.(b x a)."""
        surface = self.image.surface
        arm = (surface.points[part] - self.state.translation)[:, None]
        normal = (surface.normals[part] * surface.normal_length[part, None])[:, None]
        rotation = np.cross(np.broadcast_to(arm, slide.shape), slide)
        rotation += np.cross(np.broadcast_to(normal, by_normal.shape), by_normal)
        result = np.concatenate([rotation, slide], axis=2).transpose(1, 0, 2)
        if self._received is not None:
            result = result + self._received.by_pose(part)
        return (
            result if self.edges is None else result + self.edges.pose(part, self.state.translation)
        )

    def _focal(
        self, part: slice, slide: Float[np.ndarray, "pixels 3 3"]
    ) -> Float[np.ndarray, "3 pixels 1"]:
        """By log focal: rays turn towards the axis, as if the surface moved the other
        way.
        """
        surface = self.image.surface
        ray = surface.rays[part]
        flat = np.stack([-ray[:, 0], -ray[:, 1], np.zeros(len(ray))], axis=1)
        turn = flat - ray * np.einsum("px,px->p", flat, ray)[:, None]
        sideways = turn * surface.depth[part, None]
        result = -np.einsum("pcx,px->cp", slide, sideways)
        if self.edges is not None:
            # Shadows stay where they are in space: the lit point crosses them.
            result += np.einsum("pcx,px->cp", self.edges.by_point[part], sideways)
        return result[..., None]

    def _shape(
        self,
        part: slice,
        by_normal: Float[np.ndarray, "pixels 3 3"],
        slide: Float[np.ndarray, "pixels 3 3"],
    ) -> Float[np.ndarray, "3 pixels modes"]:
        """By the chosen weights of the shape, through sparse corner
        coefficients.
        """
        surface, rotation = self.image.surface, self.state.rotation
        corners, weights = surface.corners[part], surface.weights[part]
        count = len(corners)
        # position or normal, corner, xyz
        motion = np.empty((CHANNELS, count, 2, 3, 3), np.float32)
        motion[:, :, 0] = (slide @ rotation).transpose(1, 0, 2)[:, :, None] * weights[:, :, None]
        # (B, channel, corner, xyz)
        turned = (by_normal @ rotation)[:, :, None] * weights[:, None, :, None]
        unit = (surface.corner_normals[part] @ rotation)[:, None]
        turned -= (turned * unit).sum(-1, keepdims=True) * unit
        turned /= np.maximum(surface.normal_scale[corners], 1e-20)[:, None, :, None]
        motion[:, :, 1] = turned.transpose(1, 0, 2, 3)
        column = 3 * self._local[corners][:, None, :, None] + np.arange(3)
        column = column + 3 * self._turning_count * np.arange(2)[:, None, None]
        coefficients, column = motion.reshape(CHANNELS, count, 18), column.reshape(count, 18)
        if self._bulges is not None:  # of each corner
            by_bulge = self._by_bulge(part).T[..., None] * weights
            coefficients = np.concatenate([coefficients, by_bulge.astype(np.float32)], axis=2)
            places = self._place[corners] + 6 * self._turning_count
            column = np.concatenate([column, places], axis=1)
        column = np.broadcast_to(column.astype(np.int32), coefficients.shape)
        if self._received is not None:  # of each corner
            by_received = self._received.color(part).T[..., None] * weights
            coefficients = np.concatenate([coefficients, by_received.astype(np.float32)], axis=2)
            first = len(self._shape_basis) - self._seen_count * np.arange(CHANNELS, 0, -1)
            places = self._place[corners] + first[:, None, None]
            column = np.concatenate([column, places.astype(np.int32)], axis=2)
        width = column.shape[2]
        column = column.ravel()
        pointer = np.arange(0, CHANNELS * count * width + 1, width)
        shape = (CHANNELS * count, len(self._shape_basis))
        product = (
            sp.csr_matrix((coefficients.ravel(), column, pointer), shape=shape) @ self._shape_basis
        )
        result = product.reshape(CHANNELS, count, self._shape_basis.shape[1])
        return (
            result
            if self.edges is None
            else result + self.edges.shape(part, rotation, self._edge_basis)
        )

    def _lights(self, part: slice) -> Float32[np.ndarray, "3 pixels lights"]:
        """By the radiance of the lights, which the color is linear in."""
        image = self.image
        # Row by row in memory: BLAS takes no other order.
        diffuse = np.ascontiguousarray(image.terms.diffuse[part][:, self.light_index])
        specular = np.ascontiguousarray(image.terms.specular[part][:, self.light_index])
        indirect = image.terms.indirect
        if indirect.size:
            indirect = indirect[:, part][..., self.light_index]
        scattered = self._scattered
        if scattered is not None:
            scattered = scattered[:, part]
        return image.skin.part(part).by_lights(
            diffuse, specular, np.float32, indirect=indirect, scattered=scattered
        )

    @cached_property
    def _scattered(self) -> Float32[np.ndarray, "3 pixels lights"] | None:
        """As it comes out of the skin."""
        image = self.image
        if image.spread is None or not len(self.light_index):
            return None
        return image.spread.by_light(np.ascontiguousarray(image.terms.diffuse[:, self.light_index]))

    def _light_positions(
        self, part: slice, positions: PositionDerivatives
    ) -> Float[np.ndarray, "3 pixels angles"]:
        """By the angles of the lights: each one's own terms change, times its radiance."""
        image = self.image
        skin = image.skin.part(part)
        scattered = self._scattered_turns
        if scattered is not None:
            scattered = scattered[:, part]
        by_angle = skin.by_lights(
            positions.diffuse[part], positions.specular[part], scattered=scattered
        )
        by_angle *= image.radiance[positions.lights].T[:, None, :, None]
        first = self.layout.slices["light_position"].start + AXES * positions.lights
        return by_angle.reshape(CHANNELS, -1, AXES * len(positions.lights))[
            ..., np.isin((first[:, None] + np.arange(AXES)).ravel(), self.dense_columns)
        ]

    @cached_property
    def _scattered_turns(self) -> Float32[np.ndarray, "3 pixels strong 2"] | None:
        """What comes out of the skin of the change by the lights' angles."""
        spread = self.image.spread
        if spread is None or self.positions is None:
            return None
        return spread.by_light(self.positions.diffuse)

    def _albedo(self, part: slice) -> Float[np.ndarray, "3 pixels albedos"]:
        """By albedo: d color = diffuse part * d log albedo."""
        image, modes, surface = self.image, self._albedo_modes, self.image.surface
        pick = between_corners(surface.corners[part], surface.weights[part], modes.shape[1])
        color = image.skin.part(part).by_log_albedo(image.diffuse[part]).astype(np.float32)
        result = np.stack(
            [(pick @ modes[channel]) * color[:, channel, None] for channel in range(CHANNELS)]
        )
        if self._received is not None:
            result = result + self._received.by_albedo(part)
        return result

    def _interreflection(self, part: slice) -> Float[np.ndarray, "3 pixels 1"]:
        """By the strength of the light from other skin, which that light is proportional to."""
        image, strength = self.image, self.state.interreflection
        if not image.terms.indirect.size:
            return np.zeros((CHANNELS, len(image.color[part]), 1))
        sent = np.einsum("cpn,nc->pc", image.terms.indirect[:, part], image.radiance)
        sent /= strength
        return image.skin.part(part).radiance(sent, uniform_lobe(sent)).T[..., None]

    def _scattering(self, part: slice) -> Float[np.ndarray, "3 pixels 1"]:
        """By how far light wanders below the skin."""
        by_strength = self._by_scattering
        if by_strength is None:
            return np.zeros((CHANNELS, len(self.image.color[part]), 1))
        return self.image.skin.part(part).matte(by_strength[part]).T[..., None]

    @cached_property
    def _by_scattering(self) -> Float[np.ndarray, "pixels 3"] | None:
        """The irradiance's derivative by the strength."""
        image = self.image
        if not isinstance(image.spread, Scattering):
            return None
        return image.spread.by_strength(image.terms.diffuse @ image.radiance)

    def _translucency(self, part: slice) -> Float[np.ndarray, "3 pixels 1"]:
        """By how unevenly light comes out of the skin; a fit at none of it can come back."""
        by_excess = self.image.skin.part(part).by_excess(self.image.diffuse[part])
        return (by_excess * self._unevenness[part]).T[..., None]

    @cached_property
    def _unevenness(self) -> Float[np.ndarray, "pixels 3"]:
        if self.image.excess is not None:
            return self.image.excess / self.state.translucency
        return self.forward.unevenness(self.image.surface)

    def _texels(self, part: slice) -> sp.csr_matrix:
        """(B, texels): bilinear weights."""
        size = self.state.specular.shape[0]
        index, weight = bilinear_weights(self.forward.uvs(self.image.surface.part(part)), size)
        count = len(index)
        pointer = np.arange(0, count * 4 + 1, 4)
        return sp.csr_matrix(
            (weight.astype(np.float32).ravel(), index.ravel(), pointer), shape=(count, size * size)
        )


def _inverse3(matrix: Float[np.ndarray, "pixels 3 3"]) -> Float[np.ndarray, "pixels 3 3"]:
    """The inverses by the adjugate; a ray that grazes its triangle gives zeros, not
    infinity.
    """
    a, b, c = matrix[..., 0], matrix[..., 1], matrix[..., 2]
    rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    determinant = np.einsum("px,px->p", a, rows[:, 0])
    scale = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1) * np.linalg.norm(c, axis=1)
    safe = np.abs(determinant) > 1e-3 * np.maximum(scale, 1e-30)
    return np.where(
        safe[:, None, None], rows / np.where(safe, determinant, 1.0)[:, None, None], 0.0
    )


def _texture_gradient(
    texture: Float[np.ndarray, "texels texels"], uvs: Float[np.ndarray, "pixels 2"]
) -> Float[np.ndarray, "pixels 2"]:
    """The derivative by (u, v) of the bilinear lookup of a scalar texture."""
    size = texture.shape[0]
    index, _ = bilinear_weights(uvs, size)
    inside_x = (uvs[:, 0] * size > 0.5) & (uvs[:, 0] * size < size - 0.5)
    inside_y = ((1 - uvs[:, 1]) * size > 0.5) & ((1 - uvs[:, 1]) * size < size - 0.5)
    x = np.clip(uvs[:, 0] * size - 0.5, 0, size - 1)
    y = np.clip((1 - uvs[:, 1]) * size - 0.5, 0, size - 1)
    fx, fy = (
        x - np.minimum(x.astype(int), max(size - 2, 0)),
        y - np.minimum(y.astype(int), max(size - 2, 0)),
    )
    corner = texture.ravel()[index]
    by_x = (1 - fy) * (corner[:, 1] - corner[:, 0]) + fy * (corner[:, 3] - corner[:, 2])
    by_y = (1 - fx) * (corner[:, 2] - corner[:, 0]) + fx * (corner[:, 3] - corner[:, 1])
    return size * np.stack([by_x * inside_x, -by_y * inside_y], axis=1)
