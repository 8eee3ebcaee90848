"""One texture from several photos: each texel is the mean of what the photos say, by how well they
see it.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from facestage.contract.arrays import Bool, Float, Float64
from facestage.fit.face.geometry import FaceGeometry
from facestage.fit.face.state import State
from facestage.fit.textures.atlas import Atlas

# Cosine between view and surface from which a texel is seen in full; what is seen at a slant is
# smeared.
COSINE_FULL = 0.8
# Width of the seam where a photo's coverage ends, as a share of the texture: photos differ a little
# in tone.
SEAM_SHARE = 0.03
# Weight, relative to a photo that sees a texel in full, of the basis that all photos share. On a
# rendered person with known skin, the mean of four photos' detail without it was no better than the
# basis alone.
BASIS = 0.1


class MergedTexture:
    """The weighted mean of textures (S, S, c), taken up one photo after another; where none sees,
    their basis.
    """

    def __init__(
        self, geometry: FaceGeometry, size: int, basis: Float[np.ndarray, "vertices channels"]
    ) -> None:
        """``basis``: by vertex, what the textures are a detail of."""
        self.atlas = Atlas.build(geometry, size)
        self.geometry = geometry
        self._sum = BASIS * self.atlas.bake(basis).astype(np.float64)
        self._weight = np.full((size, size), BASIS)
        self.coverage = np.zeros((size, size), bool)  # texels that any photo shows

    def add(
        self,
        texture: Float[np.ndarray, "size size channels"],
        coverage: Bool[np.ndarray, "size size"],
        state: State,
        weight: float,
    ) -> None:
        """A photo's ``texture`` and ``coverage``, with its ``weight`` 0..1
        among the photos.
        """
        confidence = weight * _confidence(self.atlas, self.geometry, state, coverage)
        self._sum += confidence[..., None] * texture
        self._weight += confidence
        self.coverage |= coverage

    def mean(
        self, tone: Float[np.ndarray, "vertices channels"] | None = None
    ) -> Float64[np.ndarray, "size size channels"]:
        """The merged texture; ``tone``: by vertex, what is to be added to the basis."""
        total = self._sum if tone is None else self._sum + BASIS * self.atlas.bake(tone)
        return np.asarray(total / self._weight[..., None])


def _confidence(
    atlas: Atlas, geometry: FaceGeometry, state: State, coverage: Bool[np.ndarray, "size size"]
) -> Float[np.ndarray, "size size"]:
    """0..1: the cosine at which the camera sees each texel, down to 0 at the edge of the
    ``coverage``.
    """
    vertices = geometry.at(state)
    normals = geometry.vertex_normals(vertices)[0] @ state.rotation.T
    rays = vertices @ state.rotation.T + state.translation
    cosine = -np.einsum("mx,mx->m", normals, rays) / np.maximum(np.linalg.norm(rays, axis=1), 1e-9)
    seen = np.clip(atlas.bake(cosine[:, None])[..., 0] / COSINE_FULL, 0, 1) ** 2
    inside = (
        distance_transform_edt(coverage) if not coverage.all() else np.full(coverage.shape, np.inf)
    )
    return np.asarray(seen * np.minimum(inside / (SEAM_SHARE * atlas.size), 1.0))
