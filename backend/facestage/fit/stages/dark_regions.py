"""Regions of a face that are darker than the light on the rest of it can leave them: the shadow of
a cap or of hair, a beard.

What casts the shadow is not in the scene that is fitted, so its pixels would bend light and shape.
A single pixel says little: at first the shape is the landmarks' and the skin one tone. A region
does. The light is found by least squares whose weights fall with the misfit around each pixel
(Geman and McClure 1987), so that a region which is wrong as a whole takes no part, and no more
is asked of it where the model stays much brighter than the photo. How much brighter, the rest of
the face says: where its folds and cheeks are off by a third, as in a photo of hard contrast, a
cheek in half-light that is off by two thirds is nobody else's shadow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter, label, sum_labels

from facestage.contract.arrays import Bool, Float, Int
from facestage.fit.energy.evaluation import Evaluation
from facestage.fit.energy.noise import REGION_SHARE
from facestage.fit.energy.photo_term import PhotoTerm
from facestage.fit.face.light_parameters import LightParameters
from facestage.fit.stages.initialize import ridged_nnls

ROUNDS = 8
# Relative misfits of regions: what landmarks' shape and mean skin leave of a face in plain light;
# and from where on a region is dark. At the first guess none of 28 photographs of faces reached it
# without a beard, hair, or a shadow of something; docs/photographs.md.
USUAL, DARK = 0.15, 0.35
# Smaller regions, as a share of the pixels that count, are left to the robust weights; and what is
# larger than this is no region, but a photo that these lights cannot make.
AREA_MIN, AREA_MAX = 0.02, 0.6
BORDER_PX = 2  # of mixed pixels
# Misfit of a region, in root mean squares of what the light on the rest leaves of the rest, from
# where on something else darkens it; docs/photographs.md.
OUTSTANDING = 2.5
# Mean misfit of a region below which shape and light, fitted without it, explain it after all.
EXPLAINED = 0.5 * DARK


def dark_regions(
    photo: PhotoTerm, evaluation: Evaluation, lights: LightParameters
) -> Bool[np.ndarray, "height width"]:
    """The pixels of such regions in ``photo``, which ``evaluation`` is of."""
    surface, terms = evaluation.image.surface, evaluation.image.terms
    y, x = photo.index(surface)
    weights = evaluation.base_weight[y, x] * ~photo.photo.clipped[y, x].any(axis=1)
    columns = np.mean(
        list(
            evaluation.image.skin.by_light(terms.diffuse, terms.specular, indirect=terms.indirect)
        ),
        axis=0,
    )
    target = photo.photo.color[y, x].mean(axis=1)
    held = columns @ lights.fixed_radiance.mean(axis=1)
    found = np.zeros(evaluation.base_weight.shape, bool)
    if not weights.any() or not lights.fitted.any():
        return found
    lit = _Lit(columns[:, lights.fitted], target - held, held, weights)
    found[y, x] = (_regional_misfit(lit, (y, x), found.shape) > DARK) & (weights > 0)
    labels, count = label(found)
    pixels = float((weights > 0).sum())
    share = np.asarray(sum_labels(found, labels, np.arange(1, count + 1))) / pixels
    labels = np.where(np.isin(labels, 1 + np.flatnonzero(share >= AREA_MIN)), labels, 0)
    if (labels > 0).sum() > AREA_MAX * pixels:
        return np.zeros_like(found)
    found = np.isin(labels, _outstanding(lit, labels[y, x]))
    return np.asarray(binary_dilation(found, iterations=BORDER_PX))


def still_dark(
    dark: Bool[np.ndarray, "height width"], photo: PhotoTerm, evaluation: Evaluation
) -> Bool[np.ndarray, "height width"]:
    """Of the ``dark`` regions those that ``photo``, which has them, still does not explain:
    ``evaluation`` is of it, at a state that was fitted without them. A shadow of the face's own
    comes with its shape.
    """
    y, x = photo.index(evaluation.image.surface)
    weights = evaluation.base_weight
    known = np.zeros_like(weights)
    known[y, x] = weights[y, x] * ~photo.photo.clipped[y, x].any(axis=1)
    if not known.any():
        return dark
    target = photo.photo.color.mean(axis=2)
    residual = evaluation.residual.mean(axis=2)
    mean = float(np.average(target, weights=known))
    misfit = residual / (0.25 * (residual + 2 * target) + 0.5 * mean)
    labels, count = label(dark)
    numbers = np.arange(1, count + 1)
    total = np.maximum(sum_labels(known, labels, numbers), 1e-12)
    dark_still = np.asarray(sum_labels(known * misfit, labels, numbers)) / total > EXPLAINED
    return np.isin(labels, numbers[dark_still])


@dataclass(frozen=True)
class _Lit:
    """Pixels, and what each light alone would make of them."""

    columns: Float[np.ndarray, "pixels lights"]
    target: Float[np.ndarray, " pixels"]  # what is left to the fitted lights
    held: Float[np.ndarray, " pixels"]  # of the others, not in it
    weights: Float[np.ndarray, " pixels"]

    def misfit(self, believed: Float[np.ndarray, " pixels"]) -> Float[np.ndarray, " pixels"]:
        """By how much light that explains pixels as far as ``believed`` makes each brighter,
        relative to the mean of model, photo and the whole face.
        """
        model = self.columns @ ridged_nnls(self.columns, self.target, self.weights * believed)
        mean = float(np.average(self.target + self.held, weights=self.weights))
        return (model - self.target) / (0.25 * (model + self.target + 2 * self.held) + 0.5 * mean)


def _outstanding(lit: _Lit, labels: Int[np.ndarray, " pixels"]) -> Int[np.ndarray, " regions"]:
    """Those of the regions that ``labels``, 0 for none, tell apart whose misfit stands out from
    that of the rest of the face, which is some of it, under light that explains the rest.
    """
    weights, rest = lit.weights, labels == 0
    misfit = lit.misfit(rest)
    usual = np.sqrt(np.average(misfit[rest] ** 2, weights=weights[rest]))
    numbers = np.unique(labels[~rest])
    off = np.asarray(sum_labels(weights * misfit, labels, numbers))
    return numbers[off > OUTSTANDING * usual * np.asarray(sum_labels(weights, labels, numbers))]


def _regional_misfit(
    lit: _Lit, where: tuple[np.ndarray, np.ndarray], shape: tuple[int, ...]
) -> Float[np.ndarray, " pixels"]:
    """The misfit around each pixel, under light that believes what it explains."""
    weights = lit.weights
    width = REGION_SHARE * float(np.sqrt((weights > 0).sum()))

    def around(values: np.ndarray) -> np.ndarray:
        picture = np.zeros(shape)
        picture[where] = values
        return np.asarray(gaussian_filter(picture, width)[where])

    share = np.maximum(around(weights), 1e-3)
    robust, misfit = np.ones_like(weights), np.zeros_like(weights)
    for _ in range(ROUNDS):
        misfit = around(weights * lit.misfit(robust)) / share
        robust = (1.0 + (misfit / USUAL) ** 2) ** -2.0
    return misfit
