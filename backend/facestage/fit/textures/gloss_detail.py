"""Specular and roughness maps from what highlights differ from the fitted ones: one Gauss-Newton
step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from facestage.contract.arrays import Bool, Float, Int
from facestage.fit.textures.albedo_detail import ALBEDO_MIN, SHRINKAGE, SMOOTHNESS
from facestage.fit.textures.doubts import DOUBTS, PIGMENT_SIGMA
from facestage.fit.textures.shown import Shown
from facestage.fit.textures.texel_field import (
    Field,
    conjugate_gradients,
    neighbour_laplacian,
    solve_field,
    texel_rows,
)

# How far a face's skin departs from the fitted map and value, and over which share of the texture.
SPECULAR_SIGMA, ROUGHNESS_SIGMA = 0.25, 0.05
LENGTH_SHARE = 1.0 / 24.0
ROUGHNESS_MOST = 0.12  # as far as the derivative holds
# Shading errors run over several pixels: as many count as one observation.
CORRELATED_PIXELS = 16.0
CHANNELS = 3.0  # of skin say no more than one
CAUCHY_SCALE = 2.5
# Share of a highlight's change over a shift by a landmark's error that is put down to the shape.
HIGHLIGHT_MOVED = 0.2
NOISE = 0.02
STEPS, TOLERANCE = 80, 1e-3


@dataclass(frozen=True)
class GlossStep:
    """Changes of both maps, and how much of each is known, 0..1: 0 is the fitted map
    alone.
    """

    specular: Float[np.ndarray, "size size"]
    roughness: Float[np.ndarray, "size size"]
    specular_known: Float[np.ndarray, "size size"]
    roughness_known: Float[np.ndarray, "size size"]

    def within(self, seen: Float[np.ndarray, "size size"]) -> GlossStep:
        """The same where ``seen`` (0..1) is 1; elsewhere nothing changes, and nothing is known."""
        return GlossStep(**{name: seen * values for name, values in vars(self).items()})


def gloss_step(
    texels: Bool[np.ndarray, "size size"],
    shown: Shown,
    by_specular: Float[np.ndarray, "pixels 3"],
    by_roughness: Float[np.ndarray, "pixels 3"],
) -> GlossStep:
    """The change of c_spec and roughness on ``texels`` that explains what the photo
    shows.

    ``by_specular`` and ``by_roughness`` are the model's derivatives; a map whose derivative
    is 0 stays. Both maps are Gaussian fields of the deviations above, found together.
    """
    residual, sigma = _residual(shown)
    size = len(texels)
    numbers = np.full(size * size, -1)
    chosen = np.flatnonzero(texels)
    numbers[chosen] = np.arange(len(chosen))
    count = len(chosen)
    pick = texel_rows(shown.uvs, numbers, count)
    scaled = residual / sigma
    robust = 1.0 / (1.0 + (scaled**2).mean(axis=1) / CAUCHY_SCALE**2)
    weight = shown.clear * robust / (CORRELATED_PIXELS * CHANNELS)
    # In standard deviations of the fields.
    columns = (SPECULAR_SIGMA * by_specular / sigma, ROUGHNESS_SIGMA * by_roughness / sigma)

    def product(a: Float[np.ndarray, "pixels 3"], b: Float[np.ndarray, "pixels 3"]) -> sp.spmatrix:
        return pick.T @ sp.diags(weight * (a * b).sum(axis=1)) @ pick

    def solved(
        system: sp.spmatrix, right: Float[np.ndarray, " unknowns"]
    ) -> Float[np.ndarray, " unknowns"]:
        start = np.zeros((len(right), 1), np.float32)
        return conjugate_gradients(
            system.tocsr().astype(np.float32),
            right[:, None].astype(np.float32),
            start,
            TOLERANCE,
            STEPS,
        )[:, 0]

    def spread(values: Float[np.ndarray, " texels"]) -> Float[np.ndarray, "size size"]:
        result = np.zeros(size * size)
        result[chosen] = values
        return result.reshape(size, size)

    prior = field_precision(numbers.reshape(size, size), count, LENGTH_SHARE * size)
    blocks = [[product(a, b) for b in columns] for a in columns]
    right = np.concatenate(
        [pick.T @ (weight * (column * scaled).sum(axis=1)) for column in columns]
    )
    both = sp.bmat([[blocks[0][0] + prior, blocks[0][1]], [blocks[1][0], blocks[1][1] + prior]])
    specular, roughness = np.split(solved(both, right), 2)
    known = [solved(blocks[k][k] + prior, blocks[k][k] @ np.ones(count)) for k in range(2)]
    roughness = np.clip(ROUGHNESS_SIGMA * roughness, -ROUGHNESS_MOST, ROUGHNESS_MOST)
    return GlossStep(
        spread(SPECULAR_SIGMA * specular),
        spread(roughness),
        np.clip(spread(known[0]), 0, 1),
        np.clip(spread(known[1]), 0, 1),
    )


def gloss_beyond(
    texels: Bool[np.ndarray, "size size"], shown: Shown
) -> Float[np.ndarray, "size size"]:
    """0..1, what of the gloss on ``texels`` must go, because it alone is brighter than the photo:
    hair is no skin, and brows that are dark in the photo would be grey.
    """
    gloss, weight = shown.specular, shown.weight
    beyond = (gloss - shown.photo + ALBEDO_MIN * shown.diffuse) / np.maximum(gloss, 1e-9)
    density = max(float(texels.sum()) / max(len(weight), 1), 1.0)
    share = np.where(gloss > 0, np.clip(beyond, 0, 1), 0).max(axis=1, keepdims=True)
    field = Field(texels, shown.uvs, weight, share, SMOOTHNESS, SHRINKAGE / density)
    return np.clip(solve_field(field)[0][..., 0], 0, 1)


def gloss_seen(
    texels: Bool[np.ndarray, "size size"], shown: Shown
) -> Float[np.ndarray, "size size"]:
    """0..1, which of ``texels`` the photo shows, whether they shine or not: a highlight at the
    border of what is seen must not go on for the length over which gloss is alike.
    """
    density = max(float(texels.sum()) / max(len(shown.uvs), 1), 1.0)
    nothing = np.zeros((len(shown.uvs), 1))
    field = Field(texels, shown.uvs, shown.clear, nothing, SMOOTHNESS, SHRINKAGE / density)
    return np.clip(solve_field(field)[1], 0, 1)


def _residual(shown: Shown) -> tuple[Float[np.ndarray, "pixels 3"], Float[np.ndarray, "pixels 3"]]:
    """Photo minus model, and its standard deviation by all that is neither specular nor
    roughness.
    """
    model = shown.image.color
    residual = shown.photo - model
    residual = np.where(shown.clipped, np.maximum(residual, 0), residual)
    body, diffuse = shown.diffuse * shown.albedo, shown.diffuse.mean(axis=1)
    shading = DOUBTS.shading_shift * shown.change_over_shift(diffuse) / np.maximum(diffuse, 1e-9)
    relative = np.sqrt(PIGMENT_SIGMA**2 + shown.feature**2 + shown.doubt**2 + shading**2)
    displaced = HIGHLIGHT_MOVED * shown.change_over_shift(shown.specular.mean(axis=1))
    level = NOISE * (model + 0.5 * model.mean())
    return residual, np.sqrt(
        (body * relative[:, None]) ** 2 + displaced[:, None] ** 2 + level**2 + 1e-18
    )


def field_precision(
    index: Int[np.ndarray, "size size"], count: int, length: float
) -> sp.csr_matrix:
    """(n, n) inverse covariance of a field of unit variance, correlated over ``length`` texels
    (Lindgren 2011, eq. 2).

    ``index`` numbers the n texels. A plane's field of precision s (1 / length^2 - Laplacian)
    has the variance log(pi length) / (2 pi s) on a lattice, to first order.
    """
    stiffness = np.log(np.pi * max(length, 1.0)) / (2 * np.pi)
    return stiffness * (neighbour_laplacian(index, count) + sp.identity(count) / length**2)
