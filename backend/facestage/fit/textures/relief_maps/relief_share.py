"""How much of what a photo shows beyond its model is relief: asked of the directions it runs in.

Pigment has no direction. Height is seen by its slope towards the light: of its waves those along
the light's direction s over the skin, those across not at all. If both fields have no direction of
their own, the residual y = a + |g| h_s of log radiance has mean squares of its derivatives along
and across s

    <y_s^2> = P + 3 Q |g|^2,  <y_t^2> = P + Q |g|^2,

because cos^4 has the mean 3/8 and cos^2 sin^2 has 1/8. Least squares over the texels give Q, and
what is left P. The same is asked of what two photos differ by, in which there is no pigment at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from facestage.contract.arrays import Float
from facestage.fit.textures.relief_maps.height_field import PIGMENT_SIGMA, Spread
from facestage.fit.textures.relief_maps.relief_evidence import Evidence, difference

# Millimetres: the waves that are looked at, and as many texels as the shortest have at least.
SHORTEST, LONGEST, TEXELS = 2.0, 12.0, 4.0
# Gaussians of this share of a wave's length let it pass, about.
WIDTH = 1.0 / 6.0
PLAIN = 0.3  # log albedo up to which paint does not count as such
TEXELS_MIN = 2000  # below which a photo tells nothing of this
# What is found of the slopes' amplitude on skin of known relief, because log radiance is no linear
# function of steep slopes, and highlights on them run in all directions.
FOUND = 0.15
# Most that is believed of the root mean square slope of an octave: a scan's skin (0.49 mm a texel)
# has 0.016 to 0.025, deep wrinkles 0.08, and these lie where they lie, no Gaussian field.
SLOPE_MAX = 0.16
SHARE_MIN = 0.1  # below which all is taken for pigment
# Mean square of the log radiance's derivative by the slope, below which a single photo is not
# believed: light that is wrong by a little feigns as much in soft light. A lamp that falls at 45
# degrees has 1; the scan's photos have 0.6 to 1, and feign shares of up to 0.19.
SENSITIVITY_MIN = 1.3
# Share of the photos' own sensitivity from which on their light counts as another.
CHANGED = 0.2
PIGMENT_MIN = 0.005  # that skin always has


@dataclass(frozen=True)
class Found:
    """Of one photo, in an octave of wavelengths; variances may be negative by chance."""

    pigment: float  # variance of log albedo
    slope: float  # variance of both slopes together
    sensitivity: float  # mean square of the log radiance's derivative by the slope
    texels: int

    @property
    def share(self) -> float:
        """Of the residual's variance that is relief."""
        relief = 0.5 * self.slope * self.sensitivity
        return relief / max(relief + self.pigment, 1e-30)


def share_of(seen: Evidence, spacing: Float[np.ndarray, "size size"]) -> Found:
    """What one photo says."""
    known = seen.weight > 0
    if not known.any():
        return Found(0.0, 0.0, 0.0, 0)
    weight = np.minimum(seen.weight, 2 * np.median(seen.weight[known]))
    texel = float(np.median(spacing[known]))
    shortest = max(SHORTEST, TEXELS * texel)
    narrow, wide = WIDTH * shortest / texel, WIDTH * LONGEST / texel
    value = weight * seen.value / np.maximum(seen.weight, 1e-9)

    def smooth(width: float) -> Float[np.ndarray, "size size"]:
        return gaussian_filter(value, width) / np.maximum(gaussian_filter(weight, width), 1e-9)

    band = smooth(narrow) - smooth(wide)
    density = gaussian_filter(known.astype(float), narrow)
    dense = (density > 0.3 * np.median(density[known])).astype(float)
    counted = known & (gaussian_filter(dense, wide) > 0.95) & (seen.paint < PLAIN)
    if counted.sum() < TEXELS_MIN or shortest >= LONGEST / 2:
        return Found(0.0, 0.0, 0.0, int(counted.sum()))
    slope = (seen.slope / np.maximum(seen.weight, 1e-9))[:, counted]
    steep = np.hypot(*slope)
    along = slope / np.maximum(steep, 1e-9)
    by_place = np.stack([difference(band, 1)[counted], difference(band, 0)[counted]])
    with_light = (along * by_place).sum(axis=0) ** 2
    beside = (along[0] * by_place[1] - along[1] * by_place[0]) ** 2
    # By the slope: differences between texels are so many mm for it.
    square, share = (steep * texel) ** 2, weight[counted] / weight[counted].sum()
    relief = float((share * square * (with_light - beside)).sum()) / max(
        2 * float((share * square**2).sum()), 1e-30
    )
    both = float((share * (with_light + beside)).sum())
    octaves = np.log2(LONGEST / shortest)
    waves = both / max(float((share * band[counted] ** 2).sum()), 1e-30) * octaves
    sensitivity = float((share * square).sum())
    return Found(
        (both - 4 * relief * sensitivity) / max(waves, 1e-30),
        # One direction has half of the slopes' variance.
        2 * 4 * relief / max(waves, 1e-30),
        sensitivity,
        int(counted.sum()),
    )


def spread_of(found: Sequence[Found], changed: Sequence[Found] = ()) -> Spread | None:
    """How pigment and slopes vary, by all photos of one skin and by what is ``changed`` from one to
    the next; None where there is no relief to speak of.
    """
    alone, between = _mean(found), _mean(changed)
    if alone is None or alone.share < SHARE_MIN:
        return None
    if between is not None and between.sensitivity > CHANGED * alone.sensitivity:
        if between.share < SHARE_MIN:
            return None
    elif alone.sensitivity < SENSITIVITY_MIN:
        return None
    return Spread(
        float(np.sqrt(np.clip(alone.pigment, PIGMENT_MIN**2, PIGMENT_SIGMA**2))),
        min(float(np.sqrt(alone.slope)) / FOUND, SLOPE_MAX),
    )


def _mean(found: Sequence[Found]) -> Found | None:
    usable = [each for each in found if each.texels >= TEXELS_MIN]
    if not usable:
        return None
    # A photo tells as much of the slopes as it changes by them.
    texels = np.array([each.texels for each in usable])
    told = np.maximum(texels * np.array([each.sensitivity for each in usable]), 1e-9)
    return Found(
        float(np.average([each.pigment for each in usable], weights=texels)),
        float(np.average([each.slope for each in usable], weights=told)),
        float(np.average([each.sensitivity for each in usable], weights=texels)),
        int(texels.sum()),
    )
