"""What frames show of the skin's fine detail, laid flat: over the texels of the face's texture."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter, minimum_filter

from facestage.contract.arrays import Bool, Float, Float32
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.forward.reflectance import by_albedo
from facestage.fit.forward.surface_frame import FrameField
from facestage.fit.sequence.actor import Actor
from facestage.fit.sequence.frames import Cut, FrameView
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.relief_maps.relief_evidence import (
    CHANNELS,
    LOG_MAX,
    MILLIMETRES,
    by_normal,
)

# Pixels along the face, at most, and samples of each light.
FACE_PX, SAMPLES = 512.0, 4
# Where the log radiance changes more than so by the normal, light grazes: there it is no linear
# function of the slopes.
STEEPEST = 2.5
# Millimetres: longer waves are the mesh's own shape, or light that is wrong.
LONGEST = 12.0
# Linear radiance below which a pixel says nothing, and metres by which a texel may lie behind what
# is seen at its place.
DIM, BEHIND = 0.02, 0.004
NOISE = 0.05  # of the logarithm
HIGHLIGHT = 0.3  # how far highlights are off, of themselves
# How far shading is off, of what it changes within so many pixels of a place.
SHADOW_SHIFT, SHADOW = 2, 0.5
# Log albedo by which skin departs from the usual where brows, lips and nostrils are.
PAINTED = 0.45


@dataclass(frozen=True, eq=False)
class Lattice:
    """The part of the texture that shows the face."""

    geometry: FaceGeometry
    atlas: Atlas
    rows: slice
    columns: slice
    inside: Bool[np.ndarray, "size size"]  # the face's skin
    texels: Bool[np.ndarray, " covered"]  # the same among the atlas' covered texels
    spacing: float  # mm between texels, the median

    @classmethod
    def of(cls, geometry: FaceGeometry, size: int) -> Lattice:
        """Of a texture of ``size`` texels along a side."""
        atlas = Atlas.build(geometry, size)
        texels = atlas.skin[atlas.covered] & geometry.fitted[atlas.triangle]
        inside = np.zeros_like(atlas.covered)
        inside[atlas.covered] = texels
        rows, columns = (_span(inside.any(axis=axis)) for axis in (1, 0))
        frames = FrameField.of(geometry, geometry.mean).at(
            atlas.triangle[texels], atlas.weights[texels].astype(np.float64)
        )
        spacing = MILLIMETRES / size * float(np.median(np.sqrt(np.abs(frames.area))))
        return cls(geometry, atlas, rows, columns, inside, texels, spacing)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of sheets."""
        return self.rows.stop - self.rows.start, self.columns.stop - self.columns.start

    @property
    def skin(self) -> Bool[np.ndarray, "rows columns"]:
        """Where sheets show the face's skin."""
        return self.inside[self.rows, self.columns]

    def sheet(self, values: Float[np.ndarray, " texels"]) -> Float32[np.ndarray, "rows columns"]:
        """Values of the face's texels, laid out; 0 elsewhere."""
        result = np.zeros(self.shape, np.float32)
        result[self.skin] = values
        return result

    def texture(self, sheet: Float[np.ndarray, "rows columns"]) -> Float32[np.ndarray, "size size"]:
        """A sheet as a whole texture; 0 elsewhere."""
        result = np.zeros(self.inside.shape, np.float32)
        result[self.rows, self.columns] = np.where(self.skin, sheet, 0.0)
        return result

    def baked(self, values: Float[np.ndarray, " vertices"]) -> Float32[np.ndarray, "rows columns"]:
        """Values of the rendered vertices."""
        corners = self.atlas.corners[self.texels]
        return self.sheet(np.einsum("ti,ti->t", self.atlas.weights[self.texels], values[corners]))


def _span(seen: Bool[np.ndarray, " texels"]) -> slice:
    first, last = np.flatnonzero(seen)[[0, -1]]
    return slice(int(first), int(last) + 1)


@dataclass(frozen=True, eq=False)
class Sheet:
    """One frame: log radiance beyond the model's without its long waves, how much it counts
    (inverse variance), and by how much log radiance changes with a height's difference, in mm,
    between the next texel and the one before, to the right and downwards.
    """

    value: Float32[np.ndarray, "rows columns"]
    weight: Float32[np.ndarray, "rows columns"]
    slope: Float32[np.ndarray, "2 rows columns"]


def sheet_of(lattice: Lattice, actor: Actor, cut: Cut, state: State) -> Sheet:
    """What the frame ``cut`` shows, where the face is at ``state``."""
    view = FrameView.of(actor, cut, light_held=True)
    term = replace(view.term, samples=SAMPLES)
    state = replace(state, camera=view.window.camera(state.camera))
    evaluation = term.evaluate(state, 0)
    image = evaluation.image
    surface = image.surface
    row, column = term.index(surface)
    photo = np.maximum(term.photo.color[row, column], 1e-4)
    residual = (np.log(photo) - np.log(np.maximum(image.color, 1e-4))) @ CHANNELS
    residual = np.clip(residual, -2.0, 2.0)
    by_slope = by_normal(image)
    shape = term.photo.usable.shape

    def laid(values: Float[np.ndarray, " pixels"], empty: float = 0.0) -> np.ndarray:
        result = np.full(shape, empty)
        result[row, column] = values
        return result

    matte = (by_albedo(image.diffuse) * image.skin.sent).mean(axis=1)
    gloss = image.skin.gloss(image.specular).mean(axis=1)
    light = np.log(np.maximum(by_albedo(image.diffuse).mean(axis=1), 1e-6))
    width = 2 * SHADOW_SHIFT + 1
    changes = maximum_filter(laid(light, -np.inf), width) - minimum_filter(
        laid(light, np.inf), width
    )
    variance = NOISE**2 + (HIGHLIGHT * gloss / np.maximum(matte, 1e-4)) ** 2
    variance += (SHADOW * changes[row, column]) ** 2
    weight = evaluation.base_weight[row, column] * ~term.photo.clipped[row, column].any(axis=1)
    weight = weight * np.clip(photo.mean(axis=1) / DIM - 1.0, 0.0, 1.0) / variance
    weight *= 1.0 / (1.0 + ((by_slope**2).sum(axis=1) / STEEPEST**2) ** 2)
    base = actor.geometry.log_albedo.mean(axis=1)
    departure = np.abs(base - np.median(base[actor.geometry.fitted_vertices]))
    painted = np.einsum("pi,pi->p", surface.weights, departure[surface.corners])
    weight *= 1.0 / (1.0 + (painted / PAINTED) ** 8)

    atlas, texels = lattice.atlas, lattice.texels
    corners, weights = atlas.corners[texels], atlas.weights[texels].astype(np.float64)
    points = np.einsum("ti,tix->tx", weights, surface.vertices[corners])
    at = state.camera.project(points)
    place = np.nan_to_num(at[:, ::-1].T - 0.5, nan=-9.0)

    def sampled(values: Float[np.ndarray, " pixels"], order: int = 1) -> np.ndarray:
        return map_coordinates(laid(values), place, order=order, mode="constant")

    share = sampled(np.ones(len(row)))
    depth = sampled(surface.depth) / np.maximum(share, 1e-6)
    visible = (share > 0.99) & (np.linalg.norm(points, axis=1) < depth + BEHIND)
    fields = FrameField.of(lattice.geometry, surface.model_vertices)
    by_u, by_v = fields.at(atlas.triangle[texels], weights).gradients
    turned = np.stack([sampled(by_slope[:, axis]) for axis in range(3)], axis=1) @ state.rotation
    # The normal turns against the slope; a texel is 1 / size of the texture, rows run down.
    right = -np.einsum("tx,tx->t", turned, by_u) * atlas.size / MILLIMETRES
    below = np.einsum("tx,tx->t", turned, by_v) * atlas.size / MILLIMETRES
    value = lattice.sheet(np.where(visible, sampled(residual, 3), 0.0))
    counts = lattice.sheet(np.where(visible, sampled(weight), 0.0))
    value = high_pass(value, counts, LONGEST / lattice.spacing)
    counts = counts / (1.0 + (value / LOG_MAX) ** 4)
    slope = np.stack([lattice.sheet(right), lattice.sheet(below)])
    return Sheet(value, counts.astype(np.float32), slope)


def high_pass(
    value: Float[np.ndarray, "rows columns"], weight: Float[np.ndarray, "rows columns"], wave: float
) -> Float32[np.ndarray, "rows columns"]:
    """``value`` without waves longer than so many texels, where it counts."""
    known = (weight > 0).astype(np.float32)
    width = wave / 4
    low = gaussian_filter(known * value, width) / np.maximum(gaussian_filter(known, width), 1e-3)
    return (known * (value - low)).astype(np.float32)
