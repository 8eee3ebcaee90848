"""What the photo shows finer than any light could paint, where the light itself is little known.

A wrong light, a shadow in the wrong place or a shape without its folds is wrong over regions: there
the photo says nothing of the skin's tone, and what is seen of it counts little. What lies within
some millimetres of its surroundings is skin all the same: wrinkles, pores, moles, the line of the
lips. Without it such regions are blurred, and a face is another's.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from facestage.contract.arrays import Float, Float32
from facestage.fit.forward.shading import sample_bilinear
from facestage.fit.textures.doubts import DOUBTS, PIGMENT_SIGMA, Doubts, pigment_share
from facestage.fit.textures.shown import Shown, lattice
from facestage.fit.textures.texel_field import Field, solve_field
from facestage.images.local_mean import local_mean

# Deviation of the mean that a pixel is compared with, as a share of the face.
SURROUNDINGS = 0.03
# Radiance that logarithms are taken above, as a share of the mean.
DARK_SHARE = 0.02
# Of the logarithm: departures beyond are a highlight, or a shadow in another place; and of hue.
LIGHTER_MAX, DARKER_MAX, CHROMA_MAX = 0.25, 0.8, 0.15
# Shares of the doubts that an edge of shading lies elsewhere, and of the highlights'.
SHIFT, CAUTION = 1.0, 3.0
# Confidence that makes both count alike, and what a pixel has that tells of what is fine alone.
ALIKE, FINE_WEIGHT = 0.01, 0.04
UNVEILED_MAX = 2.0  # how many times what is seen through gloss the skin's own may be
COARSE = 256  # texels along the atlas that hold the rest


def fine_detail(
    shown: Shown, painted: Float[np.ndarray, "pixels 3"] | None, doubts: Doubts = DOUBTS
) -> tuple[Float[np.ndarray, "pixels 3"], Float[np.ndarray, " pixels"]]:
    """By how much log albedo departs from what it is around, whatever the light, and 0..1 how
    clearly each pixel shows that. ``painted``: log albedo that is taken off the basis there.
    """
    diffuse, specular = shown.diffuse, shown.specular
    body, gloss = np.maximum((diffuse * shown.albedo).mean(axis=1), 1e-9), specular.mean(axis=1)
    surface, rendered = shown.image.surface, shown.image.color
    floor = DARK_SHARE * max(float(rendered.mean()), 1e-9)
    matte = np.log(diffuse.mean(axis=1) + floor)
    ratio = np.log(np.maximum(shown.photo, 0) + floor) - np.log(np.maximum(rendered, 0) + floor)
    # Where red alone is clipped, the others say how bright skin is beside its surroundings.
    told = ~shown.clipped
    clear = shown.clear * told.any(axis=1)
    mean = (told * ratio).sum(axis=1) / np.maximum(told.sum(axis=1), 1)
    ratio = np.where(told, ratio, mean[:, None])
    if painted is not None:
        ratio = ratio + painted
    departure = departures(
        surface.pixels, np.column_stack([ratio, matte, gloss]), clear, shown.face_px
    )
    fine, edges, gleams = departure[:, :3], departure[:, 3], departure[:, 4]
    # Light that changes evenly is no detail, wherever it lies; nor is gloss.
    shading = SHIFT * shown.change_over_shift(edges)
    highlight = CAUTION * doubts.highlight_shift * shown.change_over_shift(gleams) / body
    sigma = np.hypot(PIGMENT_SIGMA, shown.feature)
    # Below gloss, which has none of it, a change of the albedo shows less.
    fine = fine * np.minimum((body + gloss) / body, UNVEILED_MAX)[:, None]
    fine = fine * pigment_share(fine.mean(axis=1), shading, highlight, sigma)[:, None]
    brightness = fine.mean(axis=1, keepdims=True)
    hue = np.clip(fine - brightness, -CHROMA_MAX, CHROMA_MAX)
    fine = np.clip(brightness, -DARKER_MAX, LIGHTER_MAX) + hue
    seen = shown.photo.mean(axis=1)
    lit = seen / (seen + floor)
    return fine, clear * (body / (body + gloss)) ** 2 * lit**2


def departures(
    pixels: Float[np.ndarray, "pixels 2"],
    values: Float[np.ndarray, "pixels channels"],
    clear: Float[np.ndarray, " pixels"],
    face_px: float,
) -> Float[np.ndarray, "pixels channels"]:
    """``values`` without what they are on the average of the ``clear`` (0..1) pixels around."""
    place, spacing = lattice(pixels)
    column, row = place.T
    grid = np.zeros((row.max() + 1, column.max() + 1, values.shape[1] + 1), np.float32)
    grid[row, column, :-1], grid[row, column, -1] = values, clear
    around = local_mean(grid[..., :-1], grid[..., -1], SURROUNDINGS * face_px / spacing)
    return np.asarray(values - around[row, column])


def with_fine_detail(
    field: Field, fine: Float[np.ndarray, "pixels 3"], clear: Float[np.ndarray, " pixels"]
) -> tuple[Field, Float32[np.ndarray, "size size"]]:
    """``field`` whose pixels of little weight say how ``fine`` detail departs from the smooth
    solution, and 0..1 how much of a texel was known without; ``clear`` 0..1 of each of its pixels
    shows it.
    """
    smooth = field
    while len(smooth.texels) > COARSE and len(smooth.texels) % 2 == 0:
        smooth = smooth.halved()
    found, known = solve_field(smooth)
    around = np.stack([sample_bilinear(each, field.uvs) for each in np.moveaxis(found, 2, 0)], -1)
    own = (field.weight / (field.weight + ALIKE))[:, None]
    times = len(field.texels) // len(known)
    known = np.repeat(np.repeat(known, times, axis=0), times, axis=1)
    return replace(
        field,
        values=own * field.values + (1 - own) * (around + fine),
        weight=np.maximum(field.weight, FINE_WEIGHT * clear),
    ), known
