"""Which pixels of the face something flat hides: a board, a sheet of paper, a wall, of whatever
color.

A face under any light shades: where the nose, the lips and the cheeks turn, the radiance changes. A
region of the photo that shows almost none of the change that the posed face must show there is not
the face. Only the amount of change is compared, averaged over windows, so a landmark phase that is
a few pixels off does not matter: on faces that nothing hides, the photo had at least a quarter of
the predicted contrast in every window. A textured occluder passes.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import (
    binary_dilation,
    binary_propagation,
    gaussian_filter,
    label,
    sum_labels,
    uniform_filter,
)

from facestage.fit.given.photo import Photo

# Standard deviation of the window, as a share of the face's longer side.
WINDOW_SHARE = 1.0 / 14.0
# Contrast of the photo over the model's below which a window cannot show the face.
CONTRAST_MIN = 0.08
# A seed grows over pixels as flat as itself, within this factor; added is what 8 bits round to, in
# log radiance.
GROWTH_FACTOR, GROWTH_FLOOR = 3.0, 0.004
# Least change of log radiance per pixel of a face of 64 pixels that the model must predict to be
# held to it.
MODEL_CONTRAST_MIN, REFERENCE_PX = 0.01, 64.0
# Radiance over the face's median below which shadow, not a board, is why there is no contrast; and
# the floor of logs.
DARK_SHARE, FLOOR_SHARE = 0.35, 0.1
# Share of the face below which a flat spot is left to the robust weights.
AREA_MIN = 0.02
BORDER_PX = 2


def without(photo: Photo, hidden: np.ndarray) -> Photo:
    """The photo whose ``hidden`` (h, w) bool pixels show no skin."""
    return replace(photo, skin=np.where(hidden, 0.0, photo.skin))


def flat_occluders(
    photo: np.ndarray, model: np.ndarray, used: np.ndarray, face_px: float
) -> np.ndarray:
    """(h, w) bool: pixels of ``photo`` that belong to something flat in front of the face.

    photo, model: (h, w, 3) linear radiance, the model's of the posed face under the estimated
    light. used: (h, w) bool, pixels where both are known and the photo is neither clipped nor
    masked. face_px: the face's longer side. Seeds, where the contrast is missing, grow over equally
    flat neighbours (seeded region growing, Adams & Bischof 1994) and by a border of mixed pixels.
    """
    nothing = np.zeros(used.shape, bool)
    if not used.any():
        return nothing
    mean = np.nan_to_num(photo, nan=0.0, posinf=0.0, neginf=0.0).mean(axis=2)
    median = float(np.median(mean[used]))
    if median <= 0:
        return nothing
    lit = used & (mean > DARK_SHARE * median)
    photo_change, inner = _squared_change(mean, lit, FLOOR_SHARE * median)
    model_change, _ = _squared_change(model.mean(axis=2), lit, FLOOR_SHARE * median)
    window = WINDOW_SHARE * face_px
    share = np.maximum(gaussian_filter(inner.astype(float), window), 1e-6)
    found = gaussian_filter(np.where(inner, photo_change, 0.0), window) / share
    wanted = gaussian_filter(np.where(inner, model_change, 0.0), window) / share
    least = MODEL_CONTRAST_MIN * REFERENCE_PX / face_px
    seeds = inner & (wanted > least**2) & (found < CONTRAST_MIN**2 * wanted)
    if not seeds.any():
        return nothing
    everywhere, _ = _squared_change(mean, np.ones_like(used), FLOOR_SHARE * median)
    flatness = GROWTH_FACTOR * float(np.sqrt(np.median(everywhere[seeds]))) + GROWTH_FLOOR
    # A board's own pixels in a seed's window are flat; those of the face beside it are not.
    flat = (uniform_filter(everywhere, 3) <= flatness**2) & (mean > DARK_SHARE * median)
    grown = binary_propagation(seeds & flat, mask=flat)
    return _large_regions(binary_dilation(grown, iterations=BORDER_PX), used)


def _squared_change(
    radiance: np.ndarray, known: np.ndarray, floor: float
) -> tuple[np.ndarray, np.ndarray]:
    """(h, w) squared gradient of log radiance by forward differences, and where both neighbours are
    ``known``.
    """
    logs = np.log(np.maximum(radiance, 0.0) + floor)
    change, inner = np.zeros_like(logs), known.copy()
    change[:-1] += np.diff(logs, axis=0) ** 2
    change[:, :-1] += np.diff(logs, axis=1) ** 2
    inner[:-1] &= known[1:]
    inner[:, :-1] &= known[:, 1:]
    inner[-1], inner[:, -1] = False, False
    return change, inner


def _large_regions(mask: np.ndarray, used: np.ndarray) -> np.ndarray:
    """The connected regions of ``mask`` that cover at least AREA_MIN of the ``used`` pixels."""
    labels, count = label(mask)
    covered = sum_labels(used, labels, np.arange(1, count + 1))
    large = np.flatnonzero(np.asarray(covered) >= AREA_MIN * used.sum()) + 1
    return np.isin(labels, large)
