"""The relief of the skin that is finer than the mesh: a height map, and the normal map of it.

From one photo or several of the same skin: what in them runs with the light's direction, and what
changes with the light.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from facestage.contract.arrays import Bool, Float, Float32
from facestage.contract.texture_maps import NORMAL
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.forward.shading import Image, Surface
from facestage.fit.forward.surface_frame import FrameField, Frames, turned
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.relief_maps.height_field import Spread, solved
from facestage.fit.textures.relief_maps.relief_evidence import (
    MILLIMETRES,
    About,
    Evidence,
    difference,
    evidence,
)
from facestage.fit.textures.relief_maps.relief_share import Found, share_of, spread_of
from facestage.fit.textures.shown import Shown

# Share of the light on the smooth skin that is left on its relief at least.
LIT_MIN = 0.2


@dataclass(frozen=True)
class Relief:
    """What was found."""

    height: Float32[np.ndarray, "size size"]  # mm
    normal: Float32[np.ndarray, "size size 3"]  # tangent space, 0 to 1
    pigment: Float32[np.ndarray, "size size"]  # of log albedo, beside what the model knows

    def on(self, shown: Shown, geometry: FaceGeometry, state: State) -> Surface:
        """What the pixels see, with the relief's normals."""
        frames = FrameField.of(geometry, geometry.at(state))
        return frames.mapped(shown.image.surface, shown.uvs, self.normal, state.rotation)

    def lit(self, shown: Shown, geometry: FaceGeometry, state: State) -> Shown:
        """``shown`` with the model's light on the relief instead of the smooth skin: to first
        order, which for matte skin is exact but for what relief shades.
        """
        image = shown.image
        bent = self.on(shown, geometry, state)
        change = bent.normals - image.surface.normals

        def moved(
            values: Float[np.ndarray, "pixels 3"], by_normal: Float[np.ndarray, "pixels 3 3"]
        ) -> Float[np.ndarray, "pixels 3"]:
            added = np.einsum("pcx,px->pc", by_normal, change)
            return np.maximum(values + added, LIT_MIN * values)

        diffuse = moved(image.diffuse, image.terms.diffuse_by_normal)
        specular = moved(image.specular, image.terms.specular_by_normal)
        color = image.skin.radiance(diffuse, specular)
        image = replace(image, surface=bent, diffuse=diffuse, specular=specular, color=color)
        return replace(shown, image=image)


class ReliefSeen:
    """What photos of one skin say of its relief, taken up one after another."""

    def __init__(
        self, geometry: FaceGeometry, atlas: Atlas, about: tuple[Relief, Spread] | None = None
    ) -> None:
        """``about``: a relief that is known roughly, and how pigment and slopes vary."""
        self._geometry, self._atlas = geometry, atlas
        self._frames: Frames | None = None  # of the texels, by the first photo's shape
        self._spacing = np.zeros(0)
        self._seen: Evidence | None = None
        self._last: Evidence | None = None  # of the last photo
        self._found: list[Found] = []
        self._changed: list[Found] = []  # from one photo to the next
        self._about = about

    def add(self, shown: Shown, state: State, lit: Image | None = None) -> None:
        """One photo's pixels, at the state that was fitted to it; ``lit``: with the light on the
        relief that is known roughly.
        """
        frames = FrameField.of(self._geometry, self._geometry.at(state))
        if self._frames is None:
            self._frames = frames.at(self._atlas.triangle, self._atlas.weights.astype(np.float64))
            self._spacing = np.zeros((self._atlas.size, self._atlas.size))
            texel = MILLIMETRES / self._atlas.size
            self._spacing[self._atlas.covered] = texel * np.sqrt(np.abs(self._frames.area))
        inner, about = _inner(self._atlas.skin), None
        if self._about is not None and lit is not None:
            about = About(self._about[0].height, lit)
        seen = evidence(shown, state, frames, self._spacing, inner, about)
        if about is None:
            self._found.append(share_of(seen, self._spacing))
            if self._last is not None:
                change = seen.smoothed().without(self._last.smoothed())
                self._changed.append(share_of(change, self._spacing))
            self._last = seen
        self._seen = seen if self._seen is None else self._seen + seen

    @property
    def _spread(self) -> Spread | None:
        return spread_of(self._found, self._changed) if self._about is None else self._about[1]

    def again(self) -> ReliefSeen | None:
        """To take up the same photos a second time, about the relief that was found: light is no
        linear function of its slopes, least of all in highlights; None where they show none.
        """
        spread = self._spread
        if self.found is None or spread is None:
            return None
        return ReliefSeen(self._geometry, self._atlas, (self.found, spread))

    @cached_property
    def found(self) -> Relief | None:
        """The most probable one, once all photos are taken up; None where they show none."""
        spread = self._spread
        if self._seen is None or self._frames is None or spread is None:
            return None
        known = None if self._about is None else self._about[0].pigment
        height, pigment = solved(self._seen, self._spacing, spread, known)
        height = np.where(self._atlas.skin, height, 0.0).astype(np.float32)
        normal = normal_map(self._atlas, self._frames, height)
        return Relief(height, normal, pigment.astype(np.float32))


def normal_map(
    atlas: Atlas, frames: Frames, height: Float[np.ndarray, "size size"]
) -> Float32[np.ndarray, "size size 3"]:
    """The normals of a height in mm in tangent space; flat where there is no skin, and where skin
    ends.
    """
    inner = _inner(atlas.skin)
    by_u = atlas.size * np.where(inner, difference(height, 1), 0.0)[atlas.covered]
    by_v = -atlas.size * np.where(inner, difference(height, 0), 0.0)[atlas.covered]
    bent = turned(frames.normals, frames.slopes(by_u, by_v) / MILLIMETRES)
    result = np.broadcast_to(NORMAL.default, (*height.shape, 3)).astype(np.float32)
    result[atlas.covered] = 0.5 + 0.5 * frames.in_tangent_space(bent)
    return result


def _inner(skin: Bool[np.ndarray, "size size"]) -> Bool[np.ndarray, "size size"]:
    """Skin whose four neighbours are skin."""
    return (
        skin
        & np.roll(skin, 1, 0)
        & np.roll(skin, -1, 0)
        & np.roll(skin, 1, 1)
        & np.roll(skin, -1, 1)
    )
