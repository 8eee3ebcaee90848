"""The maps of one person from several photos, each of which shows another part of the skin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from facestage.contract.arrays import Float, Int
from facestage.contract.face_model import EYES, TEETH
from facestage.contract.result import SEEN
from facestage.contract.texture_maps import REFLECTANCE_MAPS
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.forward.rendering import Textures
from facestage.fit.textures.atlas import Atlas
from facestage.fit.textures.merged_texture import MergedTexture
from facestage.fit.textures.refine import Refined
from facestage.fit.textures.stubble import grow_stubble

# How much a photo counts, beside one that shows them, whose eyes are shut or behind dark glasses,
# or whose lips are closed: it has the model's own.
UNTOLD = 1e-6


class MergedMaps:
    """Albedo (S, S, 3) of all photos, their specular and roughness maps (s, s), and what they rest
    on.
    """

    def __init__(
        self, geometry: FaceGeometry, size: int, log_albedo: Float[np.ndarray, "vertices 3"]
    ) -> None:
        """``log_albedo``: by vertex, what the photos' textures are a detail of."""
        self._detail = MergedTexture(geometry, size, log_albedo)
        self._weight = 0.0
        # Sums over the photos, by map; of the albedo the sum of logarithms.
        self._sums: dict[str, np.ndarray] = {}
        # By part, rows and columns of its texels in the albedo, and what photos count for there.
        self._texels = _texels_of_parts(self._detail.atlas, geometry)
        self._weights = dict.fromkeys(self._texels, 0.0)
        self._relief: Textures | None = None
        self._coverage = np.zeros((size, size, 3), np.uint8)
        self._told: frozenset[int] = frozenset()
        self._eyes: list[tuple[float, np.ndarray]] = []  # weights and logarithms
        self._tones: list[tuple[float, np.ndarray]] = []
        self._hair: list[tuple[float, np.ndarray]] = []

    def add(self, maps: Refined, state: State, weight: float) -> None:
        """A photo's maps, with its ``weight`` 0..1 among the photos."""
        textures = maps.textures
        # Photos differ in the light that they were given, so by a factor: the mean is one of
        # logarithms.
        logs = np.log(np.maximum(textures.albedo, 1e-6))
        self._detail.add(logs, maps.coverage[..., 0] == SEEN, state, weight)
        counts = {part: weight if part in maps.told else UNTOLD * weight for part in self._texels}
        for part, texels in self._texels.items():
            logs[texels] *= counts[part] / weight
        for each in REFLECTANCE_MAPS:
            own = logs if each.name == "albedo" else textures.known.get(each.name)
            if own is None:
                value = each.default[0] if each.plain is None else getattr(state, each.plain)
                own = np.full_like(textures.specular, value)
            self._sums[each.name] = self._sums.get(each.name, 0.0) + weight * own
        self._weight += weight
        for part, count in counts.items():
            self._weights[part] += count
        if maps.eyes is not None:
            self._eyes.append((counts[EYES], np.log(maps.eyes)))
        if maps.tone is not None:
            self._tones.append((weight, maps.tone))
        if maps.hair is not None:
            self._hair.append((weight, maps.hair))
        # Of all photos together already.
        self._relief = textures
        self._coverage = np.maximum(self._coverage, maps.coverage)
        self._told |= maps.told

    def maps(self) -> Refined:
        """The merged maps, once there is a photo: skin by how well each photo sees it, all else
        their mean.
        """
        maps = {name: total / self._weight for name, total in self._sums.items()}
        for part, texels in self._texels.items():
            maps["albedo"][texels] *= self._weight / self._weights[part]
        skin, hair = self._detail.mean(_mean(self._tones)), _mean(self._hair)
        if hair is not None:
            # What a photo shows is as that photo has it: bare, or with its stubble.
            shown = self._detail.coverage
            seen = skin[shown]
            grow_stubble(skin, self._detail.atlas, self._detail.geometry, hair)
            skin[shown] = seen
        maps["albedo"] = np.exp(np.where(self._detail.atlas.skin[..., None], skin, maps["albedo"]))
        found = {name: values.astype(np.float32) for name, values in maps.items()}
        textures = Textures(**found)
        if self._relief is not None:
            textures = replace(textures, normal=self._relief.normal, height=self._relief.height)
        eyes = _mean(self._eyes)
        picture = None if eyes is None else np.exp(eyes)
        return Refined(textures, self._coverage, picture, told=self._told)


def _texels_of_parts(
    atlas: Atlas, geometry: FaceGeometry
) -> dict[int, tuple[Int[np.ndarray, " texels"], ...]]:
    """Of eyes and teeth, rows and columns of those that show them and of those beyond their
    seams.
    """
    part = np.zeros((atlas.size, atlas.size), np.uint8)
    part[atlas.covered] = geometry.triangle_part[atlas.triangle]
    atlas.spread(part)
    return {each: np.nonzero(part == each) for each in (EYES, TEETH)}


def _mean(weighted: list[tuple[float, np.ndarray]]) -> np.ndarray | None:
    """Of arrays by their weights; None where all weigh nothing."""
    weight = sum(each for each, _ in weighted)
    return np.asarray(sum(each * values for each, values in weighted) / weight) if weight else None
