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
from facestage.fit.forward.surface_frame import FrameField, Frames, turned
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.relief_maps.height_field import difference, solved
from facestage.fit.textures.relief_maps.relief_evidence import MILLIMETRES, Evidence, evidence
from facestage.fit.textures.relief_maps.relief_share import Found, share_of, spread_of
from facestage.fit.textures.shown import Shown

SIZE_MAX = 1024  # texels along a side
# Share of the light on the smooth skin that is left on its relief at least.
LIT_MIN = 0.2


@dataclass(frozen=True)
class Relief:
    """What was found."""

    height: Float32[np.ndarray, "size size"]  # mm
    normal: Float32[np.ndarray, "size size 3"]  # tangent space, 0 to 1

    def lit(self, shown: Shown, geometry: FaceGeometry, state: State) -> Shown:
        """``shown`` with the model's light on the relief instead of the smooth skin: to first
        order, which for matte skin is exact but for what relief shades.
        """
        image = shown.image
        surface = image.surface
        frames = FrameField.of(geometry, geometry.at(state))
        bent = frames.mapped(surface, shown.uvs, self.normal, state.rotation)
        change = bent.normals - surface.normals

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

    def __init__(self, geometry: FaceGeometry, atlas: Atlas) -> None:
        """``atlas`` of the albedo; of a larger one half, a quarter, ... of the texels are used."""
        if atlas.size > SIZE_MAX:
            atlas = Atlas.build(geometry, SIZE_MAX)
        self._geometry, self._atlas = geometry, atlas
        self._frames: Frames | None = None  # of the texels, by the first photo's shape
        self._spacing = np.zeros(0)
        self._seen: Evidence | None = None
        self._found: list[Found] = []

    def add(self, shown: Shown, state: State) -> None:
        """One photo's pixels, at the state that was fitted to it."""
        frames = FrameField.of(self._geometry, self._geometry.at(state))
        if self._frames is None:
            self._frames = frames.at(self._atlas.triangle, self._atlas.weights.astype(np.float64))
            self._spacing = np.zeros((self._atlas.size, self._atlas.size))
            texel = MILLIMETRES / self._atlas.size
            self._spacing[self._atlas.covered] = texel * np.sqrt(np.abs(self._frames.area))
        seen = evidence(shown, state, frames, self._spacing, _inner(self._atlas.skin))
        self._found.append(share_of(seen, self._spacing))
        self._seen = seen if self._seen is None else self._seen + seen

    @cached_property
    def found(self) -> Relief | None:
        """The most probable one, once all photos are taken up; None where they show none."""
        spread = spread_of(self._found)
        if self._seen is None or self._frames is None or spread is None:
            return None
        height = solved(self._seen, self._spacing, spread)[0]
        height = np.where(self._atlas.skin, height, 0.0).astype(np.float32)
        return Relief(height, normal_map(self._atlas, self._frames, height))


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
