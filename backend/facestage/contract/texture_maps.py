"""The texture maps of a face: one row for each, which both sides read.

A row says how a map's file, its picture in the report, its image in Blender and its input of the
skin's material are called, and what stands in its place where a result has none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from facestage.contract.arrays import Float
from facestage.contract.brdf import SPECULAR_MAX


@dataclass(frozen=True)
class TextureMap:
    """One map over the UV square, row 0 at v = 1, linear."""

    name: str  # also a field of fit.forward.rendering.Textures
    title: str  # as people call it
    default: tuple[float, ...]  # one value for each channel: 3 of a color, else 1
    most: float = 1.0
    required: bool = True  # older results may lack the others
    # The parameter of a result that is the map's one value where there is no map; without one it is
    # the default.
    plain: str | None = None
    # Whether it is an input of the skin's reflectance; else it is one of its shape.
    reflectance: bool = True

    @property
    def file(self) -> str:
        """Its file in a result's folder."""
        return f"{self.name}.exr"

    @property
    def colored(self) -> bool:
        """Whether it holds colors."""
        return len(self.default) == 3 and self.reflectance

    @property
    def channels(self) -> int:
        """How many."""
        return len(self.default)

    @property
    def socket(self) -> str:
        """Its input of the skin's material, and its node there."""
        return self.name.capitalize()


ALBEDO = TextureMap("albedo", "Diffuse albedo", (0.5, 0.3, 0.2))
NORMAL = TextureMap("normal", "Normals", (0.5, 0.5, 1.0), required=False, reflectance=False)
HEIGHT = TextureMap("height", "Height in mm", (0.0,), required=False, reflectance=False)
TEXTURE_MAPS = (
    ALBEDO,
    TextureMap("specular", "Specular map", (1.0,), most=SPECULAR_MAX),
    TextureMap("roughness", "Roughness", (0.45,), required=False, plain="roughness"),
    NORMAL,
    HEIGHT,
)
REFLECTANCE_MAPS = tuple(each for each in TEXTURE_MAPS if each.reflectance)
# Of the eyes' part of the UV square alone (:func:`uv_box`), in more texels: the same albedo.
EYE_MAP = TextureMap("eyes", "Eyes", (0.5, 0.5, 0.5), required=False)
# Albedo over what it were without the folds of the photo's expression (contract/folds.py).
FOLD_MAP = TextureMap("folds", "Folds", (1.0, 1.0, 1.0), required=False, reflectance=False)
# They paint no skin of their own.
BESIDE_MAPS = (EYE_MAP, FOLD_MAP)
# The parameters of a result that stand in for maps.
PLAIN = tuple(each.plain for each in TEXTURE_MAPS if each.plain is not None)


def uv_box(uvs: Float[np.ndarray, "points 2"]) -> tuple[float, float, float, float]:
    """The smallest upright box round points of the UV square: left, bottom, right, top."""
    if not len(uvs):
        return 0.0, 0.0, 1.0, 1.0
    low = np.clip(uvs.min(axis=0), 0.0, 1.0).tolist()
    high = np.clip(uvs.max(axis=0), 0.0, 1.0).tolist()
    return low[0], low[1], high[0], high[1]
