"""Single strands of hair that hang into a face: too thin to count as a region of their own, and
so dark that they would be painted on the skin.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation, label, maximum

from facestage.contract.landmarks import Landmarks
from facestage.fit.given.face_areas import (
    above_brows,
    brow_pixels,
    face_pixels,
    face_size_px,
    hull_pixels,
    no_larger,
    opening_share,
)
from facestage.images.image_io import resize
from facestage.images.opencv import opencv
from facestage.models.anatomy.landmark_schemes import scheme_of

# The widest that a strand may be, and how far it and what it hangs from may seem apart, in shares
# of the face; the face's size in pixels beyond which it is looked at smaller.
WIDTH, GAP, LOOKED_AT_PX = 0.025, 0.012, 512.0
# How much darker than what is beside it, of the logarithm: all along, and somewhere. Wrinkles of
# foreheads are 0.1 to 0.3.
DARKER, DARKER_SOMEWHERE = 0.25, 0.45
# By how much three quarters of a smooth face are darker than what is beside them, at the most:
# strands on rougher skin are by as many times more.
SMOOTH = 0.125
# How far around lids their own folds and lashes lie, in shares of the face.
LIDS = 0.06
# How far below the brows strands are looked for, in ways from chin to brows: down to the nose's
# middle. Wings of noses and corners of mouths lie below.
LOWEST = -0.3
# Added to the radiance before its logarithm, as a share of the face's median.
DARK_SHARE = 0.1


def strand_pixels(photo: np.ndarray, skin: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, which pixels of ``photo`` (h, w, 3) linear show thin dark lines that come in
    from where there is no ``skin`` (h, w) 0..1.

    What is dark and thin is what a closing fills in (black top-hat, Serra 1982).
    """
    height, width = skin.shape
    if not face_size_px(landmarks) > 1.0:
        return np.zeros((height, width), bool)
    size, smaller = no_larger(landmarks, (height, width), LOOKED_AT_PX)
    if size == (width, height):
        return _strands(photo, skin, landmarks)
    found = _strands(resize(photo, *size), resize(skin, *size), smaller)
    return resize(found.astype(np.float32), width, height) > 0.5


def _strands(photo: np.ndarray, skin: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    cv2 = opencv()
    shape, face_px = (skin.shape[0], skin.shape[1]), face_size_px(landmarks)
    luminance = photo.mean(axis=2)
    other = _from_outside(skin < 0.5, landmarks)
    lids = binary_dilation(
        opening_share(shape, landmarks) > 0.1, iterations=max(round(LIDS * face_px), 1)
    )
    around = (skin >= 0.5) & (above_brows(shape, landmarks) > LOWEST)
    around &= ~brow_pixels(shape, landmarks) & ~lids
    if not (other.any() and around.any()):
        return np.zeros(shape, bool)
    dark = max(DARK_SHARE * float(np.median(luminance[skin >= 0.5])), 1e-6)
    looks = np.log(np.maximum(luminance, 0) + dark).astype(np.float32)
    reach = max(round(WIDTH * face_px / 2), 1)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    darker = cv2.morphologyEx(looks, cv2.MORPH_CLOSE, disc) - looks
    bare = hull_pixels(shape, landmarks.points[scheme_of(landmarks.scheme).skin]) & (skin >= 0.5)
    # Pores and wrinkles are on cheeks, too, and a beard is on no forehead.
    usual = min(float(np.quantile(darker[each], 0.75)) for each in (around, bare) if each.any())
    darker = np.where(around, darker / max(usual / SMOOTH, 1.0), 0.0)
    lines, count = label(darker > DARKER, np.ones((3, 3)))
    hanging = np.asarray(maximum(darker, lines, np.arange(count + 1))) > DARKER_SOMEWHERE
    gap = max(round(GAP * face_px), 1)
    hanging &= np.isin(np.arange(count + 1), lines[binary_dilation(other, iterations=gap)])
    # A line's borders mix with the skin beside it; a strand is one region with what it hangs from.
    return binary_dilation(hanging[lines], iterations=gap) & around


def _from_outside(other: np.ndarray, landmarks: Landmarks) -> np.ndarray:
    """(h, w) bool, the regions of ``other`` (h, w) that are not all within the landmarks, as eyes
    and nostrils are.
    """
    outside = ~face_pixels((other.shape[0], other.shape[1]), landmarks)
    regions, _ = label(other)
    return np.isin(regions, np.unique(regions[other & outside])) & other
