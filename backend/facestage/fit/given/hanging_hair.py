"""Hair of the skin's own hue that hangs before cheek and temple, and the shadow that it throws: far
darker than the fit makes skin there, and one region with what is known to hide the face.

A photo's colors alone do not tell a strip of brown hair from a cheek in shade, and landmarks run
below it; what the fitted light would make of a cheek does. Painted, it would be a stain.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation, gaussian_filter, label

from facestage.contract.arrays import Bool, Float
from facestage.contract.landmarks import Landmarks
from facestage.fit.given.face_areas import (
    around_mouth,
    brow_pixels,
    face_size_px,
    lips_share,
    mouth_share,
    opening_share,
)
from facestage.fit.given.skin_mask import beyond_border, border_width, large_regions
from facestage.images.opencv import opencv

# Log radiance below the fit's from which on it may be hair, and from which on surely; the share of
# a region that is sure. Freckles and folds are less, brows and beards are known by their places.
MAYBE, SURE, SURE_SHARE = 0.35, 0.7, 0.25
# Of the skin around the mouth, the share from which on what is sure is a beard: half of it on a
# rendered one, at most 0.3 on six photographs without.
BEARD_SHARE = 0.4
DARKEST = 1.5  # what is darker still says no more
# Radiance that logarithms are taken above, as a share of the mean: where the fit has hardly any
# light, half of it is no hair.
DARK_SHARE = 0.05
# As shares of the face: how far from what hides it hair hangs, over what pixels are put together,
# and how far around the openings lids and lashes are, which are as dark.
REACH, SMOOTH, LIDS = 0.15, 0.008, 0.08


def hanging_hair(
    darker: Float[np.ndarray, "height width"],
    seen: Bool[np.ndarray, "height width"],
    hiding: Bool[np.ndarray, "height width"],
    beard: Bool[np.ndarray, "height width"],
    landmarks: Landmarks,
) -> Bool[np.ndarray, "height width"]:
    """The pixels that show such hair, and those at its border, which mix it with skin.

    ``darker``: by how much log radiance lies below the fit's at pixels that are ``seen`` to show
    the face; ``hiding``: what is no skin, as far as colors tell.
    """
    face_px = face_size_px(landmarks)
    size = (seen.shape[0], seen.shape[1])
    nothing = np.zeros(size, bool)
    if not (face_px > 1.0 and seen.any()):
        return nothing
    border = border_width(face_px)
    hiding = large_regions(hiding, border)
    if not hiding.any():
        return nothing
    cv2 = opencv()
    away = cv2.distanceTransform((~hiding).astype(np.uint8), cv2.DIST_L2, 5)
    over = SMOOTH * face_px
    total = gaussian_filter(np.where(seen, np.clip(darker, -DARKEST, DARKEST), 0.0), over)
    level = total / np.maximum(gaussian_filter(seen.astype(float), over), 1e-3)
    dark = seen & ~hiding & ~beard & ~_dark_features(size, landmarks)
    dark &= level > MAYBE
    # A beard that covers the skin is as dark, and grows around the mouth.
    mouth = around_mouth(size, landmarks) & ~_lips(size, landmarks) & seen
    if mouth.any() and float((level[mouth] > SURE).mean()) > BEARD_SHARE:
        regions, _ = label(dark)
        dark &= ~np.isin(regions, np.unique(regions[dark & mouth]))
    regions, count = label(large_regions(dark & (away < REACH * face_px), border))
    sizes = np.bincount(regions.ravel(), minlength=count + 1)
    sure = np.bincount(regions.ravel(), (level > SURE).ravel(), count + 1)
    near = binary_dilation(hiding, iterations=int(np.ceil(2 * border)))
    hangs = np.isin(np.arange(count + 1), regions[near]) & (sure > SURE_SHARE * sizes)
    hangs[0] = False
    return np.asarray(beyond_border(hangs[regions], border) < 0.5)


def darker_than(
    photo: Float[np.ndarray, "pixels 3"], rendered: Float[np.ndarray, "pixels 3"]
) -> Float[np.ndarray, " pixels"]:
    """By how much log radiance of the ``photo`` lies below what is ``rendered``, as
    :func:`hanging_hair` asks.
    """
    seen, expected = np.maximum(photo.mean(axis=1), 0), np.maximum(rendered.mean(axis=1), 0)
    floor = max(DARK_SHARE * float(expected.mean()), 1e-9) if len(expected) else 1.0
    return np.asarray(np.log(expected + floor) - np.log(seen + floor))


def _dark_features(
    shape: tuple[int, int], landmarks: Landmarks
) -> Bool[np.ndarray, "height width"]:
    """Lids, brows and lips."""
    cv2 = opencv()
    opening = (opening_share(shape, landmarks) > 0.1).astype(np.uint8)
    reach = 2 * max(round(LIDS * face_size_px(landmarks)), 1) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    lids = cv2.dilate(opening, disc) > 0
    return np.asarray(lids | brow_pixels(shape, landmarks) | _lips(shape, landmarks))


def _lips(shape: tuple[int, int], landmarks: Landmarks) -> Bool[np.ndarray, "height width"]:
    """And what lies between them."""
    return np.asarray(lips_share(shape, landmarks) + mouth_share(shape, landmarks) > 0.3)
