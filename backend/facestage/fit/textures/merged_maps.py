"""The maps of one person from several photos, each of which shows another part of the skin."""

from __future__ import annotations

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.result import SEEN
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.forward.rendering import Textures
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.merged_texture import MergedTexture
from facestage.fit.textures.refine import Refined


class MergedMaps:
    """Albedo (S, S, 3) of all photos, their specular and roughness maps (s, s), and what they rest
    on.
    """

    def __init__(
        self, geometry: FaceGeometry, size: int, log_albedo: Float[np.ndarray, "vertices 3"]
    ) -> None:
        """``log_albedo``: by vertex, what the photos' textures are a detail of."""
        self._skin = Atlas.build(geometry, size).skin
        self._detail = MergedTexture(geometry, size, log_albedo)
        self._weight = 0.0
        # Sums of the logarithm of the albedo, of c_spec and of roughness.
        self._sums: list[np.ndarray | float] = [0.0, 0.0, 0.0]
        self._coverage = np.zeros((size, size, 3), np.uint8)

    def add(self, maps: Refined, state: State, weight: float) -> None:
        """A photo's maps, with its ``weight`` 0..1 among the photos."""
        textures = maps.textures
        # Photos differ in the light that they were given, so by a factor: the mean is one of
        # logarithms.
        logs = np.log(np.maximum(textures.albedo, 1e-6))
        roughness = np.full_like(textures.specular, state.roughness)
        rough = roughness if textures.roughness is None else textures.roughness
        self._detail.add(logs, maps.coverage[..., 0] == SEEN, state, weight)
        self._sums = [
            total + weight * own
            for total, own in zip(self._sums, (logs, textures.specular, rough), strict=True)
        ]
        self._weight += weight
        self._coverage = np.maximum(self._coverage, maps.coverage)

    def maps(self) -> Refined:
        """The merged maps, once there is a photo: skin by how well each photo sees it, all else
        their mean.
        """
        logs, specular, roughness = (np.asarray(total) / self._weight for total in self._sums)
        albedo = np.exp(np.where(self._skin[..., None], self._detail.mean(), logs))
        textures = Textures(*(each.astype(np.float32) for each in (albedo, specular, roughness)))
        return Refined(textures, self._coverage)
