"""One texture from several photos: each texel is the mean of what the photos say, by how well they see it."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from facestage.fit.atlas import Atlas
from facestage.fit.geometry import FaceGeometry
from facestage.fit.parameters import State

# Cosine between view and surface from which a texel is seen in full; what is seen at a slant is smeared.
COSINE_FULL = 0.8
# Width of the seam where a photo's coverage ends, as a share of the texture: photos differ a little in tone.
SEAM_SHARE = 0.03
# Weight, relative to a texel that is seen in full, of what a photo's fit guesses where it sees nothing.
GUESS = 1e-4


class MergedTexture:
    """The weighted mean of textures (S, S, c), taken up one photo after another."""

    def __init__(self, geometry: FaceGeometry, size: int, channels: int = 3) -> None:
        self._atlas = Atlas.build(geometry, size)
        self._geometry = geometry
        self._sum, self._weight = np.zeros((size, size, channels)), np.zeros((size, size))
        self.coverage = np.zeros((size, size), bool)  # texels that any photo shows

    def add(
        self, texture: np.ndarray, coverage: np.ndarray, state: State, face_px: float, variance: float = 1.0
    ) -> None:
        """A photo's ``texture`` (S, S, c) and ``coverage`` (S, S) bool; its face is ``face_px`` pixels large.

        As in a least-squares fit, a texel counts by the number of pixels that show it, over their ``variance``.
        """
        confidence = face_px**2 / variance * (_confidence(self._atlas, self._geometry, state, coverage) + GUESS)
        self._sum += confidence[..., None] * texture
        self._weight += confidence
        self.coverage |= coverage

    def mean(self) -> np.ndarray:
        """(S, S, c) float64, once there is a photo."""
        return np.asarray(self._sum / self._weight[..., None])


def _confidence(atlas: Atlas, geometry: FaceGeometry, state: State, coverage: np.ndarray) -> np.ndarray:
    """(S, S) 0..1: the cosine at which the camera sees each texel, down to 0 at the edge of the ``coverage``."""
    vertices = geometry.vertices(state.identity, state.expression)
    normals = geometry.vertex_normals(vertices)[0] @ state.rotation.T
    rays = vertices @ state.rotation.T + state.translation
    cosine = -np.einsum("mx,mx->m", normals, rays) / np.maximum(np.linalg.norm(rays, axis=1), 1e-9)
    seen = np.clip(atlas.bake(cosine[:, None])[..., 0] / COSINE_FULL, 0, 1) ** 2
    inside = distance_transform_edt(coverage) if not coverage.all() else np.full(coverage.shape, np.inf)
    return np.asarray(seen * np.minimum(inside / (SEAM_SHARE * atlas.size), 1.0))
