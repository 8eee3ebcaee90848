"""The maps of one person from several photos, each of which shows another part of the skin."""

from __future__ import annotations

import numpy as np

from facestage.contract.result import SEEN
from facestage.fit.geometry import FaceGeometry
from facestage.fit.merged_texture import MergedTexture
from facestage.fit.parameters import State
from facestage.fit.refine import Refined
from facestage.fit.rendering import Textures


class MergedMaps:
    """Albedo (S, S, 3) of all photos, their specular and roughness maps (s, s), and what they rest on."""

    def __init__(self, geometry: FaceGeometry, size: int, gloss_size: int) -> None:
        self._albedo = MergedTexture(geometry, size)
        self._gloss = MergedTexture(geometry, gloss_size, channels=2)
        self._coverage = np.zeros((size, size, 3), np.uint8)

    def add(self, maps: Refined, state: State, face_px: float) -> None:
        """The maps of a photo in which the face is ``face_px`` pixels large."""
        textures, seen = maps.textures, maps.coverage[..., 0] == SEEN
        gloss = np.stack([textures.specular, np.broadcast_to(_roughness(textures, state), textures.specular.shape)], -1)
        # Photos differ in the light that they were given, so by a factor: the mean is one of logarithms.
        self._albedo.add(np.log(np.maximum(textures.albedo, 1e-6)), seen, state, face_px)
        row = (np.arange(len(gloss)) + 0.5) * len(seen) // len(gloss)
        self._gloss.add(gloss, seen[np.ix_(row.astype(int), row.astype(int))], state, face_px)
        self._coverage = np.maximum(self._coverage, maps.coverage)

    def maps(self) -> Refined:
        """The merged maps, once there is a photo."""
        gloss = self._gloss.mean().astype(np.float32)
        albedo = np.exp(self._albedo.mean()).astype(np.float32)
        return Refined(Textures(albedo, gloss[..., 0], gloss[..., 1]), self._coverage)


def _roughness(textures: Textures, state: State) -> np.ndarray:
    return np.array(state.roughness) if textures.roughness is None else textures.roughness
