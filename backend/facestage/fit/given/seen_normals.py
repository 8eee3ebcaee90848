"""Normals that a photo's pixels see, of a fitted face and of the true one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Bool, Float, Int
from facestage.fit.face.state import State
from facestage.fit.forward.rendering import face_pixels
from facestage.fit.forward.shading import ForwardModel, Surface, pixel_rays, sample_bilinear
from facestage.fit.forward.surface_frame import FrameField, Frames, turned

PIXELS_MAX = 400_000
FACING = 0.3  # cosine between view and true normal, below which a pixel is left out


@dataclass(frozen=True)
class SeenNormals:
    """Pixels that see the compared part of both faces; camera frame."""

    forward: ForwardModel
    state: State
    surface: Surface  # of the fitted face
    true_frames: Frames
    true_uvs: Float[np.ndarray, "pixels 2"]
    compared: Bool[np.ndarray, " pixels"]

    @classmethod
    def of(
        cls,
        forward: ForwardModel,
        state: State,
        vertices: Float[np.ndarray, "vertices 3"],
        compared: Int[np.ndarray, " _"],
    ) -> SeenNormals:
        """``vertices``: the true ones; ``compared``: those whose triangles count."""
        geometry = forward.geometry
        pixels = face_pixels(forward, state)
        step = int(np.ceil(np.sqrt(max(len(pixels), 1) / PIXELS_MAX)))
        pixels = pixels[(pixels % step == 0).all(axis=1)]
        inside = np.zeros(len(geometry.mean), bool)
        inside[compared] = True
        counted = inside[geometry.triangles].all(axis=1)
        forward.tracer.update(vertices - state.translation)
        hits = forward.tracer.first_hits(-state.translation, pixel_rays(state.camera, pixels + 0.5))
        hit = (hits.triangle >= 0) & counted[hits.triangle]
        surface = forward.surface(state, pixels[hit] + 0.5, only_fitted=True)
        row = pixels[:, 1] * state.camera.width + pixels[:, 0]
        found = np.floor(surface.pixels).astype(int)
        index = np.searchsorted(row, found[:, 1] * state.camera.width + found[:, 0])
        triangle, weights = hits.triangle[index], hits.barycentric[index].astype(np.float64)
        corners = geometry.model.uvs[geometry.triangle_uvs[triangle]].astype(np.float64)
        return cls(
            forward,
            state,
            surface,
            FrameField.of(geometry, vertices).at(triangle, weights),
            np.einsum("pi,pix->px", weights, corners),
            counted[surface.triangle],
        )

    def true_normals(
        self, tile: tuple[float, float, float], height_mm: Float[np.ndarray, "texels texels"]
    ) -> Float[np.ndarray, "pixels 3"]:
        """Of the true face with a height on it, whose map covers the ``tile`` (u, v, side) of the
        texture.
        """
        u, v, side = tile
        place = (self.true_uvs - np.array([u, v])) / side
        reach = 0.5 / len(height_mm)

        def slope(axis: int) -> Float[np.ndarray, " pixels"]:
            step = reach * np.eye(2)[axis]
            after, before = (sample_bilinear(height_mm, place + k * step) for k in (1, -1))
            return 1e-3 * (after - before) / (2 * reach * side)

        frames = self.true_frames
        return turned(frames.normals, frames.slopes(slope(0), slope(1)))

    def found_normals(
        self, normal_map: Float[np.ndarray, "texels texels 3"] | None
    ) -> Float[np.ndarray, "pixels 3"]:
        """Of the fitted face, with a normal map or without."""
        if normal_map is None:
            return self.surface.normals
        frames = FrameField.of(self.forward.geometry, self.surface.model_vertices)
        uvs = self.forward.uvs(self.surface)
        return frames.mapped(self.surface, uvs, normal_map, self.state.rotation).normals

    def angle(
        self,
        found: Float[np.ndarray, "pixels 3"],
        true: Float[np.ndarray, "pixels 3"],
        turn: Float[np.ndarray, "3 3"],
    ) -> float:
        """Mean, in degrees, after ``turn`` of the found ones; NaN where no pixel counts."""
        facing = -np.einsum("px,px->p", true, self.surface.rays) > FACING
        counted = self.compared & facing
        if not counted.any():
            return float("nan")
        cosine = np.einsum("px,px->p", found @ turn.T, true)[counted]
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))).mean())
