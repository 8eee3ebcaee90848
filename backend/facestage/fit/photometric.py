"""The photometric term: derivatives of the rendered radiance by every parameter, streamed in blocks.

The visibility of lights is held fixed unless the edges of shadows are given (shadow_edges.py); everything else is
exact but for the focal length, whose column leaves out that the lit point also shifts sideways and is seen from
elsewhere (a tenth of it, with lights a metre away; the landmarks carry most of what is known of the lens). At a
fixed pixel, moving the surface by dx changes where its ray lands: (db1, db2, dt) = -M^-1 dx with M = [e1, e2, -ray],
which moves albedo, normal and specular value across the triangle and the point along the ray.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from facestage.contract import brdf
from facestage.fit.parameters import CHANNELS, Layout, State
from facestage.fit.shading import ForwardModel, Image, bilinear_weights
from facestage.fit.shadow_edges import ShadowEdges

BLOCK_PIXELS = 8192


@dataclass(frozen=True)
class JacobianBlock:
    """Rows of the Jacobian for a block of pixels: row 3 * pixel + channel."""

    rows: slice  # of the (3 P) residual vector
    dense: np.ndarray  # (3 B, columns up to and including roughness) float32
    specular: sp.csr_matrix  # (3 B, specular texels)


def jacobian_blocks(
    forward: ForwardModel, state: State, image: Image, layout: Layout, active: np.ndarray,
    edges: ShadowEdges | None = None,
) -> Iterator[JacobianBlock]:  # fmt: skip
    """d color / d parameters in blocks of pixels. Columns of inactive parameters stay zero.

    With ``edges``, what moving the shadows changes is part of it.
    """
    differential = _Differential(forward, state, image, layout, active, edges)
    for start in range(0, len(image.color), BLOCK_PIXELS):
        yield differential.block(start, min(start + BLOCK_PIXELS, len(image.color)))


class _Differential:
    """Quantities shared by all blocks of one evaluation."""

    def __init__(
        self, forward: ForwardModel, state: State, image: Image, layout: Layout, active: np.ndarray,
        edges: ShadowEdges | None = None,
    ) -> None:  # fmt: skip
        self.forward, self.state, self.image, self.layout = forward, state, image, layout
        self.edges = edges
        self.active = {name: bool(active[where].any()) for name, where in layout.slices.items()}
        self.geometry = forward.geometry
        if self.active["identity"] or self.active["expression"]:
            wanted = np.zeros(len(self.geometry.mean), bool)
            wanted[image.surface.corners] = True
            self.normal_operator = self.geometry.normal_operator(image.surface.model_vertices, wanted)
        if self.active["lights"]:
            self.light_jacobian = forward.lights.jacobian(state.lights)

    def block(self, start: int, end: int) -> JacobianBlock:
        image, layout, active = self.image, self.layout, self.active
        part = slice(start, end)
        count = end - start
        dense = np.zeros((count * CHANNELS, layout.slices["specular"].start), np.float32)
        by_normal, slide = self._surface_derivatives(part)
        if self.edges is not None:
            slide += self.edges.by_surface[part]
        if active["pose"]:
            dense[:, layout.slices["pose"]] = self._pose(part, by_normal, slide)
        if active["focal"]:
            dense[:, layout.slices["focal"]] = self._focal(part, slide)
        if active["identity"] or active["expression"]:
            shape = self._shape(part, by_normal, slide)
            dense[:, layout.slices["identity"]] = shape[:, : self.geometry.identity_count]
            dense[:, layout.slices["expression"]] = shape[:, self.geometry.identity_count :]
        if active["lights"]:
            dense[:, layout.slices["lights"]] = self._lights(part)
        if active["albedo"]:
            dense[:, layout.slices["albedo"]] = self._albedo(part)
        if active["roughness"]:
            by_roughness = image.terms.specular_by_roughness[part] @ image.radiance
            dense[:, layout.slices["roughness"]] = (brdf.K_SPECULAR * image.c_spec[part, None] * by_roughness).reshape(
                -1, 1
            )
        return JacobianBlock(slice(start * CHANNELS, end * CHANNELS), dense, self._specular(part))

    def _surface_derivatives(self, part: slice) -> tuple[np.ndarray, np.ndarray]:
        """d color by the interpolated normal (B, 3, 3) and by surface motion (B, 3, 3).

        The motion term already contains what sliding across the triangle changes.
        """
        image, surface, terms = self.image, self.image.surface, self.image.terms
        albedo, radiance = image.albedo[part] * (brdf.K_DIFFUSE / np.pi), image.radiance
        c_spec = brdf.K_SPECULAR * image.c_spec[part, None]
        by_depth = albedo * (terms.diffuse_by_depth[part] @ radiance) + c_spec * (
            terms.specular_by_depth[part] @ radiance
        )
        diffuse_n = np.einsum("pjx,jc->pcx", terms.diffuse_by_normal[part], radiance, optimize=True)
        specular_n = np.einsum("pjx,jc->pcx", terms.specular_by_normal[part], radiance, optimize=True)
        by_unit = albedo[..., None] * diffuse_n + c_spec[..., None] * specular_n
        # Through the normalisation of the interpolated normal: tangential part only, over its length.
        normal, length = surface.normals[part], surface.normal_length[part]
        along = np.einsum("pcx,px->pc", by_unit, normal)
        by_normal = (by_unit - along[..., None] * normal[:, None]) / length[:, None, None]

        corners = surface.vertices[surface.corners[part]]
        edges = np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], -surface.rays[part]], axis=-1)
        inverse = _inverse3(edges)  # rows: db1, db2, dt per -dx
        by_edge = []
        corner_normals = surface.corner_normals[part]
        logs = self.forward.log_albedo(self.state)[surface.corners[part]]
        diffuse_color = albedo * image.diffuse[part] * (image.albedo[part] < brdf.ALBEDO_MAX)
        uvs = self.geometry.model.uvs[self.geometry.triangle_uvs[surface.triangle[part]]]
        gradient = _texture_gradient(self.state.specular, self.forward.uvs(surface)[part])
        for edge in (1, 2):
            change = diffuse_color * (logs[:, edge] - logs[:, 0])
            change += np.einsum("pcx,px->pc", by_normal, corner_normals[:, edge] - corner_normals[:, 0])
            spec_change = np.einsum("px,px->p", gradient, uvs[:, edge] - uvs[:, 0])
            change += brdf.K_SPECULAR * image.specular[part] * spec_change[:, None]
            by_edge.append(change)
        rates = np.stack([*by_edge, by_depth], axis=-1)  # (B, channel, 3)
        return by_normal, -np.einsum("pci,pix->pcx", rates, inverse)

    def _pose(self, part: slice, by_normal: np.ndarray, slide: np.ndarray) -> np.ndarray:
        """(3 B, 6): rotation about the model's origin, then translation. a.(w x b) = w.(b x a)."""
        surface = self.image.surface
        arm = (surface.points[part] - self.state.translation)[:, None]
        normal = (surface.normals[part] * surface.normal_length[part, None])[:, None]
        rotation = np.cross(np.broadcast_to(arm, slide.shape), slide)
        rotation += np.cross(np.broadcast_to(normal, by_normal.shape), by_normal)
        result = np.concatenate([rotation, slide], axis=2).reshape(-1, 6)
        return result if self.edges is None else result + self.edges.pose(part, self.state.translation)

    def _focal(self, part: slice, slide: np.ndarray) -> np.ndarray:
        """(3 B, 1) by log focal: rays turn towards the axis, as if the surface moved the other way."""
        surface = self.image.surface
        ray = surface.rays[part]
        flat = np.stack([-ray[:, 0], -ray[:, 1], np.zeros(len(ray))], axis=1)
        turn = flat - ray * np.einsum("px,px->p", flat, ray)[:, None]
        sideways = turn * surface.depth[part, None]
        result = -np.einsum("pcx,px->pc", slide, sideways)
        if self.edges is not None:
            # Shadows stay where they are in space: the lit point crosses them.
            result += np.einsum("pcx,px->pc", self.edges.by_point[part], sideways)
        return result.reshape(-1, 1)

    def _shape(self, part: slice, by_normal: np.ndarray, slide: np.ndarray) -> np.ndarray:
        """(3 B, k + e) by identity and expression weights, through sparse corner coefficients."""
        surface, rotation = self.image.surface, self.state.rotation
        corners, weights = surface.corners[part], surface.weights[part]
        count, vertices = len(corners), len(self.geometry.mean)
        moved = (slide @ rotation)[:, :, None] * weights[:, None, :, None]  # (B, channel, corner, xyz)
        turned = (by_normal @ rotation)[:, :, None] * weights[:, None, :, None]
        unit = (surface.corner_normals[part] @ rotation)[:, None]
        turned -= (turned * unit).sum(-1, keepdims=True) * unit
        turned /= np.maximum(surface.normal_scale[corners], 1e-20)[:, None, :, None]
        column = (3 * corners[:, None, :, None] + np.arange(3)).astype(np.int32)
        column = np.broadcast_to(column, moved.shape).reshape(-1)
        pointer = np.arange(0, count * CHANNELS * 9 + 1, 9)
        shape = (count * CHANNELS, 3 * vertices)
        by_position = sp.csr_matrix((moved.astype(np.float32).ravel(), column, pointer), shape=shape)
        by_vertex_normal = sp.csr_matrix((turned.astype(np.float32).ravel(), column, pointer), shape=shape)
        result = (by_position + by_vertex_normal @ self.normal_operator) @ self.geometry.basis
        return result if self.edges is None else result + self.edges.shape(part, rotation, self.geometry.basis)

    def _lights(self, part: slice) -> np.ndarray:
        """(3 B, light parameters): the color is linear in the radiance."""
        image, fitted = self.image, self.forward.lights.fitted
        diffuse = image.terms.diffuse[part][:, fitted]
        specular = image.terms.specular[part][:, fitted] * (brdf.K_SPECULAR * image.c_spec[part, None])
        albedo = image.albedo[part] * (brdf.K_DIFFUSE / np.pi)
        per_channel = [
            (albedo[:, channel, None] * diffuse + specular) @ self.light_jacobian[:, channel]
            for channel in range(CHANNELS)
        ]
        return np.stack(per_channel, axis=1).reshape(-1, self.light_jacobian.shape[2])

    def _albedo(self, part: slice) -> np.ndarray:
        """(3 B, d): d color = diffuse part * d log albedo."""
        image, surface, basis = self.image, self.image.surface, self.geometry.albedo_basis
        corners, count = surface.corners[part], part.stop - part.start
        pick = sp.csr_matrix(
            (surface.weights[part].astype(np.float32).ravel(), corners.ravel(), np.arange(0, 3 * count + 1, 3)),
            shape=(count, basis.shape[1]),
        )
        color = image.albedo[part] * image.diffuse[part] * (brdf.K_DIFFUSE / np.pi)
        color = (color * (image.albedo[part] < brdf.ALBEDO_MAX)).astype(np.float32)
        result = np.empty((count, CHANNELS, len(basis)), np.float32)
        for channel in range(CHANNELS):
            result[:, channel] = (pick @ basis[:, :, channel].T) * color[:, channel, None]
        return result.reshape(-1, len(basis))

    def _specular(self, part: slice) -> sp.csr_matrix:
        """(3 B, texels): bilinear weights times the specular radiance."""
        size = self.state.specular.shape[0]
        index, weight = bilinear_weights(self.forward.uvs(self.image.surface)[part], size)
        count = len(index)
        data = (brdf.K_SPECULAR * self.image.specular[part])[:, :, None] * weight[:, None]
        column = np.broadcast_to(index[:, None], data.shape)
        pointer = np.arange(0, count * CHANNELS * 4 + 1, 4)
        data = data.astype(np.float32).ravel() * self.active["specular"]
        return sp.csr_matrix((data, column.ravel(), pointer), shape=(count * CHANNELS, size * size))


def _inverse3(matrix: np.ndarray) -> np.ndarray:
    """(P, 3, 3) inverses by the adjugate; a ray that grazes its triangle gives zeros, not infinity."""
    a, b, c = matrix[..., 0], matrix[..., 1], matrix[..., 2]
    rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
    determinant = np.einsum("px,px->p", a, rows[:, 0])
    scale = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1) * np.linalg.norm(c, axis=1)
    safe = np.abs(determinant) > 1e-3 * np.maximum(scale, 1e-30)
    return np.where(safe[:, None, None], rows / np.where(safe, determinant, 1.0)[:, None, None], 0.0)


def _texture_gradient(texture: np.ndarray, uvs: np.ndarray) -> np.ndarray:
    """(P, 2) derivative by (u, v) of the bilinear lookup of a scalar texture."""
    size = texture.shape[0]
    index, _ = bilinear_weights(uvs, size)
    inside_x = (uvs[:, 0] * size > 0.5) & (uvs[:, 0] * size < size - 0.5)
    inside_y = ((1 - uvs[:, 1]) * size > 0.5) & ((1 - uvs[:, 1]) * size < size - 0.5)
    x = np.clip(uvs[:, 0] * size - 0.5, 0, size - 1)
    y = np.clip((1 - uvs[:, 1]) * size - 0.5, 0, size - 1)
    fx, fy = x - np.minimum(x.astype(int), max(size - 2, 0)), y - np.minimum(y.astype(int), max(size - 2, 0))
    corner = texture.ravel()[index]
    by_x = (1 - fy) * (corner[:, 1] - corner[:, 0]) + fy * (corner[:, 3] - corner[:, 2])
    by_y = (1 - fx) * (corner[:, 2] - corner[:, 0]) + fx * (corner[:, 3] - corner[:, 1])
    return size * np.stack([by_x * inside_x, -by_y * inside_y], axis=1)
