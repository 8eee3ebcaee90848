"""Light below the skin in pictures of any size: found on a lattice as coarse as skin blurs light.

Pixels may be far smaller than what light wanders. What comes out of the skin is smooth beyond
SPACING but for detail of the light finer than that, of which a share stays where it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Bool, Float, Float32, Int
from facestage.contract.face_model import SKIN
from facestage.contract.light_stage import LightStage
from facestage.fit.face.state import State
from facestage.fit.forward.scattering import spectrum
from facestage.fit.forward.shading import ForwardModel, Surface
from facestage.render.light_terms import Asked

SPACING = 0.7e-3  # m between the points of the lattice, where the picture has more pixels
LIGHT_SAMPLES = 8  # of each of its points, per light
# How far off a pixel's tangent plane a point of the lattice may lie, in their distances.
OFF_PLANE = 1.0


@dataclass(frozen=True)
class LatticeLight:
    """What comes out of the skin at points that every ``step``-th pixel sees."""

    forward: ForwardModel
    surface: Surface
    corner: Float[np.ndarray, " 2"]  # the first point's pixel
    step: int
    angle: float  # radians between neighbours
    index: Int[np.ndarray, "rows columns"]  # of the lattice's points; -1: no skin is seen there
    kept: Float[np.ndarray, " 3"]  # share of finer detail that stays
    # what comes out of the skin beyond the share that is kept
    moved: Float32[np.ndarray, "points 3 lights"]

    @classmethod
    def under(
        cls,
        forward: ForwardModel,
        state: State,
        stage: LightStage,
        pixels: Int[np.ndarray, "pixels 2"],
        seed: int,
    ) -> LatticeLight:
        """Under ``stage``, in what ``pixels`` (a box of them) see of the skin."""
        spacing = float(np.linalg.norm(state.translation)) / state.camera.focal_px
        step = max(round(SPACING / spacing), 1)
        low, high = pixels.min(axis=0), pixels.max(axis=0)
        columns, rows = ((high - low) // step + 1).tolist()
        y, x = np.mgrid[:rows, :columns]
        corner = low + 0.5 * step
        places = np.stack([x.ravel(), y.ravel()], axis=1)
        surface = forward.surface(state, corner + step * places)
        skin = forward.geometry.triangle_part[surface.triangle] == SKIN
        surface = surface.part(skin)
        found = np.round((surface.pixels - corner) / step).astype(int)
        index = np.full((rows, columns), -1)
        index[found[:, 1], found[:, 0]] = np.arange(len(found))
        terms = forward.light_terms(
            state, surface, stage, LIGHT_SAMPLES, seed, Asked(specular=False), bounced=False
        )
        scattering = forward.scattering(surface, state.scattering)
        # Between the shortest wave that the lattice has and half of that.
        shortest = np.array([2 * (np.pi / (step * spacing)) ** 2])
        kept = spectrum(shortest, state.scattering)[0][0]
        moved = scattering.by_light(terms.diffuse)
        moved -= kept[:, None, None].astype(np.float32) * terms.diffuse
        return cls(
            forward,
            surface,
            corner,
            step,
            step / state.camera.focal_px,
            index,
            kept,
            np.ascontiguousarray(moved.swapaxes(0, 1)),
        )

    def at(self, surface: Surface) -> PixelLight:
        """As other pixels of the same face see it."""
        pick, known = self._interpolation(surface)
        return PixelLight(pick, known, self.kept, self.moved)

    def _interpolation(self, surface: Surface) -> tuple[sp.csr_matrix, Bool[np.ndarray, " pixels"]]:
        """(pixels, points): bilinear between the points of the same piece of skin; and where there
        are any.
        """
        place = (surface.pixels - self.corner) / self.step
        first = np.floor(place).astype(int)
        share = place - first
        rows, columns = self.index.shape
        found, weights = [], []
        for right, down in _CORNERS:
            x, y = first[:, 0] + right, first[:, 1] + down
            inside = (x >= 0) & (x < columns) & (y >= 0) & (y < rows)
            point = np.where(inside, self.index[y.clip(0, rows - 1), x.clip(0, columns - 1)], -1)
            weight = np.abs(1 - right - share[:, 0]) * np.abs(1 - down - share[:, 1])
            found.append(point.clip(0))
            weights.append(weight * (point >= 0) * self._beside(surface, point.clip(0)))
        weight, point = np.stack(weights, axis=1), np.stack(found, axis=1)
        total = weight.sum(axis=1)
        known = (total > 1e-3) & (self.forward.geometry.triangle_part[surface.triangle] == SKIN)
        weight = np.where(known[:, None], weight / np.maximum(total, 1e-3)[:, None], 0.0)
        shape = (len(point), len(self.surface.pixels))
        pointer = np.arange(0, weight.size + 1, len(_CORNERS))
        pick = sp.csr_matrix((weight.astype(np.float32).ravel(), point.ravel(), pointer), shape)
        return pick, known

    def _beside(
        self, surface: Surface, point: Int[np.ndarray, " pixels"]
    ) -> Bool[np.ndarray, " pixels"]:
        """Whether the lattice's ``point`` of each pixel lies on the same skin."""
        if not len(self.surface.pixels):
            return np.zeros(len(point), bool)
        off = self.surface.points[point] - surface.points
        distance = np.abs(np.einsum("px,px->p", off, surface.normals))
        return distance < OFF_PLANE * self.angle * surface.depth


@dataclass(frozen=True)
class PixelLight:
    """What some pixels see come out of the skin; a Spread."""

    pick: sp.csr_matrix  # (pixels, points)
    known: Bool[np.ndarray, " pixels"]  # where there are points
    kept: Float[np.ndarray, " 3"]
    moved: Float32[np.ndarray, "points 3 lights"]

    def lit(
        self, diffuse: Float[np.ndarray, "pixels lights"], radiance: Float[np.ndarray, "lights 3"]
    ) -> Float[np.ndarray, "pixels 3"]:
        """See :class:`facestage.fit.forward.scattering.Spread`."""
        moved = np.einsum("pcl,lc->pc", self.moved, radiance.astype(np.float32))
        return self._share * (diffuse @ radiance) + self.pick @ moved

    def by_light(
        self, diffuse: Float[np.ndarray, "pixels lights"]
    ) -> Float32[np.ndarray, "3 pixels lights"]:
        """See :class:`facestage.fit.forward.scattering.Spread`."""
        count, lights = diffuse.shape
        moved = self.pick @ self.moved.reshape(len(self.moved), -1)
        result = moved.reshape(count, -1, lights).transpose(1, 0, 2)
        return result + self._share.T[:, :, None].astype(np.float32) * diffuse

    @property
    def _share(self) -> Float[np.ndarray, "pixels 3"]:
        return np.where(self.known[:, None], self.kept, 1.0)


# To the right, and down.
_CORNERS = ((0, 0), (1, 0), (0, 1), (1, 1))
