"""The albedo as a texture, with the per-texel detail that the albedo basis cannot express."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.ndimage import binary_closing, distance_transform_edt
from scipy.sparse.linalg import cg

from facestage.contract import brdf
from facestage.contract.face_model import SKIN
from facestage.fit.geometry import FaceGeometry
from facestage.fit.shading import Image, bilinear_weights
from facestage.render.tracer import RayTracer

ALBEDO_MIN = 0.005
# Darker than the basis by more than this is a shadow's edge or an occluder, not skin; lighter may be fair brows
# where the model has dark ones.
LOG_DARKER_MAX, LOG_LIGHTER_MAX = 0.7, 1.3
# Irradiance, relative to the brightest tenth of the face, below which the photo says little of the skin: at the
# edge of a shadow a small error of the light is a large one of the albedo.
LIT_FULL = 0.4
# No pigment of skin turns it blue or green: a larger change of hue is a highlight taken for skin.
LOG_CHROMA_MAX = 0.5
# Per photo pixel of full confidence: tie of neighbouring texels, and of each texel to the albedo basis.
SMOOTHNESS, SHRINKAGE = 0.08, 0.003
# How much skin differs from the albedo basis, and beyond how many times the doubt of its shading it surely does.
PIGMENT_SIGMA, PLAIN_FACTOR = 0.06, 2.0
CONJUGATE_GRADIENT_STEPS = 200
COVERED_CONFIDENCE = 0.05


@dataclass(frozen=True)
class Atlas:
    """Which point of the mesh each texel of a (S, S) texture shows."""

    size: int
    covered: np.ndarray  # (S, S) bool
    skin: np.ndarray  # (S, S) bool
    corners: np.ndarray  # (covered texels, 3) vertex indices
    weights: np.ndarray  # (covered texels, 3) barycentric
    nearest: tuple[np.ndarray, np.ndarray]  # row and column of the nearest covered texel

    @classmethod
    def build(cls, geometry: FaceGeometry, size: int) -> Atlas:
        """Rasterise the UV triangles by tracing one ray through each texel's centre."""
        uvs = geometry.model.uvs
        tracer = RayTracer(geometry.triangle_uvs, len(uvs))
        tracer.update(np.concatenate([uvs, np.zeros((len(uvs), 1))], axis=1))
        v, u = np.mgrid[:size, :size]
        origin = np.stack([(u + 0.5) / size, 1.0 - (v + 0.5) / size, np.ones(u.shape)], axis=-1).reshape(-1, 3)
        hits = tracer.first_hits(origin, np.broadcast_to([0.0, 0.0, -1.0], origin.shape))
        covered = (hits.triangle >= 0).reshape(size, size)
        triangle = hits.triangle[hits.triangle >= 0]
        skin = np.zeros((size, size), bool)
        skin[covered] = geometry.triangle_part[triangle] == SKIN
        nearest = distance_transform_edt(~covered, return_distances=False, return_indices=True)
        return cls(
            size, covered, skin, geometry.triangles[triangle],
            hits.barycentric[hits.triangle >= 0], (nearest[0], nearest[1]),
        )  # fmt: skip

    def bake(self, values: np.ndarray) -> np.ndarray:
        """(S, S, c) texture of vertex values (m, c); uncovered texels repeat the nearest covered one."""
        texture = np.zeros((self.size, self.size, values.shape[1]), np.float32)
        texture[self.covered] = np.einsum("ti,tic->tc", self.weights, values[self.corners])
        return texture[self.nearest]


def detail_texture(
    atlas: Atlas, log_albedo: np.ndarray, image: Image, uvs: np.ndarray, photo: np.ndarray, weights: np.ndarray,
    doubt: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """(S, S, 3) log-albedo correction that explains what the basis left of the photo, and (S, S) bool coverage.

    ``log_albedo`` (S, S, 3) is the basis' texture; ``uvs`` (P, 2), ``photo`` (P, 3) and confidence
    ``weights`` (P, 3) belong to the pixels of ``image``, ``doubt`` (P,) is that of their shading (shading_doubt.py).
    A smooth, shrunken least-squares fit: where the face is dark or unseen it says nothing and decays to zero.
    """
    diffuse = brdf.K_DIFFUSE / np.pi * image.diffuse
    specular = brdf.K_SPECULAR * image.c_spec[:, None] * image.specular
    lit = diffuse / max(float(np.percentile(diffuse, 90)), 1e-9)
    index, bilinear = bilinear_weights(uvs, atlas.size)
    pick = _sparse_rows(index, bilinear, atlas.size**2)
    wanted = np.log(np.clip((photo - specular) / np.maximum(diffuse, 1e-9), ALBEDO_MIN, 0.95))
    target = wanted - pick @ log_albedo.reshape(-1, 3)
    # Relative error of the albedo grows where little of the light is diffuse.
    share = diffuse * image.albedo / np.maximum(diffuse * image.albedo + specular, 1e-9)
    reach = np.where(target < 0, LOG_DARKER_MAX, LOG_LIGHTER_MAX)
    robust = 1.0 / (1.0 + (target / reach) ** 4)
    confidence = weights * np.minimum(lit / LIT_FULL, 1.0) ** 3 * share**2 * robust
    brightness = target.mean(axis=1, keepdims=True)
    confidence *= pigment_share(brightness[:, 0], doubt)[:, None]
    chroma = np.clip(target - brightness, -LOG_CHROMA_MAX, LOG_CHROMA_MAX)
    target = np.clip(brightness, -LOG_DARKER_MAX, LOG_LIGHTER_MAX) + chroma

    texels = np.flatnonzero(atlas.skin)
    compact = np.full(atlas.size**2, -1)
    compact[texels] = np.arange(len(texels))
    pick = pick[:, texels]
    laplacian = _texel_laplacian(atlas.skin, compact)
    density = max(len(texels) / max(len(photo), 1), 1.0)  # texels per pixel: the tie is per pixel
    result = np.zeros((atlas.size**2, 3))
    for channel in range(3):
        weighted = pick.multiply(confidence[:, channel, None]).tocsr()
        system = (pick.T @ weighted).tocsr() + SMOOTHNESS * laplacian + (SHRINKAGE / density) * sp.identity(len(texels))
        jacobi = sp.diags(1.0 / system.diagonal())
        solution, _ = cg(system, weighted.T @ target[:, channel], rtol=1e-4, maxiter=CONJUGATE_GRADIENT_STEPS, M=jacobi)
        result[texels, channel] = solution
    seen = np.zeros(atlas.size**2, bool)
    seen[texels] = np.asarray(pick.T @ confidence.mean(1)).ravel() > COVERED_CONFIDENCE / density
    # Between the pixels of a coarse photo lie texels that none of them touches; they are seen all the same.
    gap = 2 * int(np.ceil(np.sqrt(density))) + 1
    covered = binary_closing(seen.reshape(atlas.size, atlas.size), np.ones((gap, gap)))
    return result.reshape(atlas.size, atlas.size, 3), covered & atlas.skin


def pigment_share(brightness: np.ndarray, doubt: np.ndarray) -> np.ndarray:
    """(P,) 0..1, how much of a residual of the log albedo is more likely pigment than wrong shading.

    What is small may be either; what is many times larger than the shading's ``doubt`` (P,) can only be pigment.
    """
    common = PIGMENT_SIGMA**2 / (PIGMENT_SIGMA**2 + doubt**2)
    plain = brightness**2 / (brightness**2 + (PLAIN_FACTOR * doubt) ** 2 + 1e-12)
    return np.maximum(common, plain)


def _sparse_rows(index: np.ndarray, weight: np.ndarray, columns: int) -> sp.csr_matrix:
    count, width = index.shape
    return sp.csr_matrix(
        (weight.ravel(), index.ravel(), np.arange(0, count * width + 1, width)), shape=(count, columns)
    )


def _texel_laplacian(skin: np.ndarray, compact: np.ndarray) -> sp.csr_matrix:
    """Graph Laplacian of the skin texels, four neighbours each."""
    index = compact.reshape(skin.shape)
    pairs = []
    for a, b in ((index[:, :-1], index[:, 1:]), (index[:-1], index[1:])):
        both = (a >= 0) & (b >= 0)
        pairs.append(np.stack([a[both], b[both]], axis=1))
    edges = np.concatenate(pairs)
    count = int(skin.sum())
    ones = np.ones(len(edges))
    rows = np.arange(len(edges))
    incidence = sp.csr_matrix(
        (np.concatenate([ones, -ones]), (np.concatenate([rows, rows]), edges.T.ravel())), shape=(len(edges), count)
    )
    return (incidence.T @ incidence).tocsr()
